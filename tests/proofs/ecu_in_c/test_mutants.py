"""Faults built into the ECU's C, one at a time: what they are, and that the recorded periods notice them."""

import pytest

from tests.proofs.ecu_in_c import campaign, mutants
from tests.proofs.ecu_in_c.mutator import mutated

pytestmark = pytest.mark.compiler
NAME = "not planning ahead"
SOURCE = """# 1 "small.c"
static int clamp(int value, int low)
{
  if (value < low) value = low;
  return value - 1;
}
"""


def test_each_operator_condition_constant_and_statement_has_its_mutants():
    assert [str(mutant) for mutant in mutated("small.c", SOURCE, 40).mutants] == [
        "small.c:3.1: `value < low` becomes `(value) <= (low)`",
        "small.c:3.2: `value < low` becomes `(value) >= (low)`",
        "small.c:3.3: `value < low` becomes `!(value < low)`",
        "small.c:3.4: `value = low` becomes ``",
        "small.c:4.1: `1` becomes `(1 + 1)`",
        "small.c:4.2: `1` becomes `(1 - 1)`",
        "small.c:4.3: `value - 1` becomes `(value) + (1)`",
    ]
    assert [mutant.number for mutant in mutated("small.c", SOURCE, 40).mutants] == list(range(40, 47))


@pytest.mark.proofs  # a library of seventy mutants
def test_the_gates_mutants_that_survive_are_explained(tmp_path):
    mutation = mutants.build(NAME, tmp_path, ("sw_gate.c",))
    recordings = [campaign.recording(NAME, seed, 1_200, mutation.layout) for seed in "13"]
    alive = mutants.survivors(mutation, recordings, range(len(mutation.mutants) + 1))
    # Without a mutant all is as recorded.
    assert alive[0] == 0 and len(mutation.mutants) > 60
    texts = [str(mutation.mutants[number - 1]) for number in alive[1:]]
    unexplained = [text for text in mutants.unexplained(texts) if not text.startswith("no survivor fits")]
    assert unexplained == []
