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
SANITISED = (LONG_WINDOWS, "quick to doubt", "classic, impatient", "authenticated")


def recorded(name, seeds, periods=PERIODS):
    """Hostile periods of a variant, most of them near an edge."""
    layout = Layout(sources(VARIANTS[name]))
    return [campaign.recording(name, seed, periods, layout) for seed in seeds]


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
    [
        ((LONG_WINDOWS,), FAULTS[:1], 300),
        pytest.param((*SANITISED,), FAULTS, PERIODS, marks=pytest.mark.proofs),
    ],
    ids=["one", "all"],
)
def test_sanitisers_find_what_is_planted_and_nothing_else(names, faults, periods, tmp_path):
    recordings = {name: recorded(name, "1", periods)[0] for name in names}
    for name, recording in recordings.items():
        done = sanitised(name, recording, tmp_path / name)
        assert (done.returncode, done.stderr, done.stdout) == (0, "", f"{periods} periods\n"), name
    for file, old, new, complaint in faults:
        contents = sources(VARIANTS[LONG_WINDOWS])
        assert contents[file].count(old.encode()) == 1
        contents[file] = contents[file].replace(old.encode(), new.encode())
        done = sanitised(LONG_WINDOWS, recordings[LONG_WINDOWS], tmp_path / file, contents)
        assert done.returncode != 0 and complaint in done.stderr, file


@pytest.mark.proofs  # six libraries without optimisation, and gcovr
def test_every_branch_is_taken_and_one_that_is_not_is_seen(tmp_path):
    recordings = {name: recorded(name, "13") for name in VARIANTS}
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
