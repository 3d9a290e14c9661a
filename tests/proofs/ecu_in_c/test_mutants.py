"""What mutants a source has; `python -m tests.proofs ecu_c` tries those of the ECU."""

from tests.proofs.ecu_in_c.mutator import mutated

SOURCE = """# 1 "small.c"
static int clamp(int value, int low)
{
  if (value < low) value = low;
  return value - 1;
}
"""


def test_each_operator_condition_constant_and_statement_has_its_mutants():
    _, mutants = mutated("small.c", SOURCE, 40)
    assert [str(mutant) for mutant in mutants] == [
        "small.c:3.1: `value < low` becomes `(value) <= (low)`",
        "small.c:3.2: `value < low` becomes `(value) >= (low)`",
        "small.c:3.3: `value < low` becomes `!(value < low)`",
        "small.c:3.4: `value = low` becomes ``",
        "small.c:4.1: `1` becomes `(1 + 1)`",
        "small.c:4.2: `1` becomes `(1 - 1)`",
        "small.c:4.3: `value - 1` becomes `(value) + (1)`",
    ]
    assert [mutant.number for mutant in mutants] == list(range(40, 47))
