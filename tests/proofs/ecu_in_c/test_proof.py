"""Short runs of what `python -m tests.proofs ecu_c` does at length; and recorded periods under sanitisers."""

import subprocess

import pytest

from tests.proofs.ecu_in_c import branch_coverage, campaign
from tests.proofs.ecu_in_c.library import Layout, Library, sources
from tests.proofs.ecu_in_c.mutator import mutated
from tests.proofs.ecu_in_c.planted import Planted
from tests.proofs.ecu_in_c.variants import VARIANTS

SMALL = """# 1 "small.c"
static int clamp(int value, int low)
{
  if (value < low) value = low;
  return value - 1;
}
"""


def test_each_operator_condition_constant_and_statement_has_its_mutants():
    _, mutants = mutated("small.c", SMALL, 40)
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


@pytest.mark.compiler
def test_both_answer_alike_to_forged_repeated_and_damaged_frames(tmp_path):
    name = "authenticated, at all speeds"
    found = campaign.stretch(Library(sources(VARIANTS[name]), tmp_path / "ecu.so"), name, "0", 400)
    assert found.mismatch is None, found.mismatch
    assert found.modes.keys() >= {"CONTROL", "HOLD", "FAULT"}


SANITISERS = (
    *("-O0", "-fno-sanitize-recover=all", "-g1"),
    "-fsanitize=address,undefined,float-divide-by-zero,float-cast-overflow",
)
LONG_WINDOWS = "late actuator, long windows"
SANITISED = (LONG_WINDOWS, "quick to doubt", "classic, impatient", "authenticated")
FAULTS = (
    Planted("sw_fail_safe.c", "UINT64_MAX >> (64 - SW_LOSS_WINDOW)", "(1ull << SW_LOSS_WINDOW) - 1u", "exponent 64"),
    Planted("sw_memory.c", "k + 1 < SW_WINDOW; k++", "k < SW_WINDOW; k++", "out of bounds"),
)


def sanitised(name, recording, folder, contents=None):
    """The end of a replay under sanitisers."""
    folder.mkdir()
    program, compared = branch_coverage.replay_program(name, folder, SANITISERS, contents)
    periods = folder / "periods"
    periods.write_bytes(recording)
    return subprocess.run([program, compared, periods], capture_output=True, text=True, check=False)


@pytest.mark.compiler
@pytest.mark.skipif(not branch_coverage.is_possible(), reason="gcc, or gcovr (extra dev), is not installed")
@pytest.mark.parametrize(
    ("names", "faults", "periods"),
    [((LONG_WINDOWS,), FAULTS[:1], 300), pytest.param(SANITISED, FAULTS, 1_200, marks=pytest.mark.proofs)],
    ids=["one", "all"],
)
def test_sanitisers_find_what_is_planted_and_nothing_else(names, faults, periods, tmp_path):
    layouts = {name: Layout(sources(VARIANTS[name])) for name in names}
    recordings = {name: campaign.recording(name, "1", periods, layout) for name, layout in layouts.items()}
    for name, recording in recordings.items():
        done = sanitised(name, recording, tmp_path / name)
        assert (done.returncode, done.stderr, done.stdout) == (0, "", f"{periods} periods\n"), name
    for fault in faults:
        contents = fault.into(sources(VARIANTS[LONG_WINDOWS]))
        done = sanitised(LONG_WINDOWS, recordings[LONG_WINDOWS], tmp_path / fault.file, contents)
        assert done.returncode != 0 and fault.what in done.stderr, fault
