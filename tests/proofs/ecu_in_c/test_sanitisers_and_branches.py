"""Recorded periods through the ECU in C under sanitisers, and which of its branches they take."""

import subprocess

import pytest

from tests.proofs.ecu_in_c import branch_coverage, campaign
from tests.proofs.ecu_in_c.library import Layout, sources
from tests.proofs.ecu_in_c.variants import VARIANTS

pytestmark = [
    pytest.mark.compiler,
    pytest.mark.skipif(not branch_coverage.is_possible(), reason="gcc, or gcovr (extra dev), is not installed"),
]
SANITISERS = (
    "-fsanitize=address,undefined,float-divide-by-zero,float-cast-overflow",
    "-fno-sanitize-recover=all",
    "-g1",
)
PERIODS = 1_200
LONG_WINDOWS = "late actuator, long windows"


@pytest.fixture(scope="module")
def recordings():
    """Hostile periods of each variant, most of them near an edge."""
    layouts = {name: Layout(sources(VARIANTS[name])) for name in VARIANTS}
    return {
        name: [campaign.recording(name, seed, PERIODS, layout) for seed in "13"] for name, layout in layouts.items()
    }


def sanitised(name, recordings, folder, contents=None):
    """The end of a replay under sanitisers."""
    folder.mkdir()
    program, compared = branch_coverage.replay_program(name, folder, SANITISERS, contents)
    periods = folder / "periods"
    periods.write_bytes(recordings[name][0])
    return subprocess.run([program, compared, periods], capture_output=True, text=True, check=False)


def test_sanitisers_find_what_is_planted_and_nothing_else(recordings, tmp_path):
    for name in ("quick to doubt", LONG_WINDOWS, "classic, impatient"):
        done = sanitised(name, recordings, tmp_path / name)
        assert (done.returncode, done.stderr, done.stdout) == (0, "", f"{PERIODS} periods\n"), name
    for file, old, new, complaint in (
        ("sw_memory.c", "k + 1 < SW_WINDOW; k++", "k < SW_WINDOW; k++", "out of bounds"),
        ("sw_fail_safe.c", "UINT64_MAX >> (64 - SW_LOSS_WINDOW)", "(1ull << SW_LOSS_WINDOW) - 1u", "shift exponent 64"),
    ):
        contents = sources(VARIANTS[LONG_WINDOWS])
        assert contents[file].count(old.encode()) == 1
        contents[file] = contents[file].replace(old.encode(), new.encode())
        done = sanitised(LONG_WINDOWS, recordings, tmp_path / file, contents)
        assert done.returncode != 0 and complaint in done.stderr, file


@pytest.mark.proofs  # six libraries without optimisation, and gcovr
def test_every_branch_is_taken_and_one_that_is_not_is_seen(recordings, tmp_path):
    every, few = tmp_path / "every", tmp_path / "few"
    every.mkdir()
    few.mkdir()
    coverage = branch_coverage.measured(recordings, every)
    assert coverage.missed == [] and coverage.branches > 300
    assert coverage.excluded == len(branch_coverage.EXCLUDED)
    # With one variant alone, planning is never late, and no one doubts a sensor.
    name = "classic, impatient"
    coverage = branch_coverage.measured({name: recordings[name]}, few)
    assert coverage.percent < 100.0 and coverage.missed
