"""Recorded periods through the ECU in C under sanitisers."""

import subprocess

import pytest

from tests.proofs.ecu_in_c import branch_coverage, campaign
from tests.proofs.ecu_in_c.library import Layout, sources
from tests.proofs.ecu_in_c.planted import changed
from tests.proofs.ecu_in_c.variants import VARIANTS

pytestmark = [
    pytest.mark.compiler,
    pytest.mark.skipif(not branch_coverage.is_possible(), reason="gcc, or gcovr (extra dev), is not installed"),
]
SANITISERS = (
    *("-O0", "-fno-sanitize-recover=all", "-g1"),
    "-fsanitize=address,undefined,float-divide-by-zero,float-cast-overflow",
)
PERIODS = 1_200
LONG_WINDOWS = "late actuator, long windows"
SANITISED = (LONG_WINDOWS, "quick to doubt", "classic, impatient", "authenticated")


def sanitised(name, recording, folder, contents=None):
    """The end of a replay under sanitisers."""
    folder.mkdir()
    program, compared = branch_coverage.replay_program(name, folder, SANITISERS, contents)
    periods = folder / "periods"
    periods.write_bytes(recording)
    return subprocess.run([program, compared, periods], capture_output=True, text=True, check=False)


FAULTS = (
    ("sw_fail_safe.c", "UINT64_MAX >> (64 - SW_LOSS_WINDOW)", "(1ull << SW_LOSS_WINDOW) - 1u", "shift exponent 64"),
    ("sw_memory.c", "k + 1 < SW_WINDOW; k++", "k < SW_WINDOW; k++", "out of bounds"),
)


@pytest.mark.parametrize(
    ("names", "faults", "periods"),
    [((LONG_WINDOWS,), FAULTS[:1], 300), pytest.param((*SANITISED,), FAULTS, PERIODS, marks=pytest.mark.proofs)],
    ids=["one", "all"],
)
def test_sanitisers_find_what_is_planted_and_nothing_else(names, faults, periods, tmp_path):
    layouts = {name: Layout(sources(VARIANTS[name])) for name in names}
    recordings = {name: campaign.recording(name, "1", periods, layout) for name, layout in layouts.items()}
    for name, recording in recordings.items():
        done = sanitised(name, recording, tmp_path / name)
        assert (done.returncode, done.stderr, done.stdout) == (0, "", f"{periods} periods\n"), name
    for file, old, new, complaint in faults:
        contents = changed(sources(VARIANTS[LONG_WINDOWS]), file, old, new)
        done = sanitised(LONG_WINDOWS, recordings[LONG_WINDOWS], tmp_path / file, contents)
        assert done.returncode != 0 and complaint in done.stderr, file
