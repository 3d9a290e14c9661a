"""Faults built into the ECU's C, one at a time: what they are, and that the recorded periods notice them."""

import pytest

from tests.proofs.ecu_in_c import campaign, mutants
from tests.proofs.ecu_in_c.library import Layout, sources
from tests.proofs.ecu_in_c.mutator import mutated
from tests.proofs.ecu_in_c.variants import VARIANTS

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
    texts = [mutant.text for mutant in mutated("small.c", SOURCE, 1).mutants]
    assert texts == [
        "`value < low` becomes `(value) <= (low)`",
        "`value < low` becomes `(value) >= (low)`",
        "`value < low` becomes `!(value < low)`",
        "`value = low` becomes ``",
        "`1` becomes `(1 + 1)`",
        "`1` becomes `(1 - 1)`",
        "`value - 1` becomes `(value) + (1)`",
    ]


def test_mutants_are_numbered_on_from_the_first_and_placed_by_line():
    found = mutated("small.c", SOURCE, 40).mutants
    assert [mutant.number for mutant in found] == list(range(40, 47))
    assert [mutant.place for mutant in found[:5]] == [
        ("small.c", 3, 1), ("small.c", 3, 2), ("small.c", 3, 3), ("small.c", 3, 4), ("small.c", 4, 1),
    ]  # fmt: skip


@pytest.fixture(scope="module")
def mutation(tmp_path_factory):
    return mutants.build(NAME, tmp_path_factory.mktemp("mutants"), ("sw_gate.c",))


@pytest.fixture(scope="module")
def recordings():
    layout = Layout(sources(VARIANTS[NAME]))
    return [campaign.recording(NAME, seed, 1_200, layout) for seed in "13"]


def test_without_a_mutant_all_is_as_recorded(mutation, recordings):
    assert mutants.survivors(mutation, recordings, [0]) == [0]


def test_the_gates_mutants_that_survive_are_explained(mutation, recordings):
    alive = mutants.survivors(mutation, recordings, range(1, len(mutation.mutants) + 1))
    texts = [str(mutation.mutants[number - 1]) for number in alive]
    assert len(mutation.mutants) > 60
    unexplained = [text for text in mutants.unexplained(texts) if not text.startswith("no survivor fits")]
    assert unexplained == []
