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
NAMES = ("quick to doubt", "late actuator, long windows", "classic, impatient")


@pytest.fixture(scope="module")
def recordings():
    """Hostile periods of each variant, most of them near an edge."""
    layouts = {name: Layout(sources(VARIANTS[name])) for name in VARIANTS}
    return {
        name: [campaign.recording(name, seed, PERIODS, layout) for seed in "13"] for name, layout in layouts.items()
    }


def replayed(program, compared, content, tmp_path):
    periods = tmp_path / "periods"
    periods.write_bytes(content)
    return subprocess.run([program, compared, periods], capture_output=True, text=True, check=False)


@pytest.mark.parametrize("name", NAMES)
def test_sanitisers_find_nothing_in_hostile_periods(recordings, name, tmp_path):
    program, compared = branch_coverage.replay_program(name, tmp_path, SANITISERS)
    done = replayed(program, compared, recordings[name][0], tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == f"{PERIODS} periods\n"


@pytest.mark.parametrize(
    ("file", "old", "new", "complaint"),
    [
        ("sw_memory.c", "k + 1 < SW_WINDOW; k++", "k < SW_WINDOW; k++", "out of bounds"),
        ("sw_fail_safe.c", "UINT64_MAX >> (64 - SW_LOSS_WINDOW)", "(1ull << SW_LOSS_WINDOW) - 1u", "shift exponent 64"),
    ],
)
def test_a_fault_that_is_planted_is_found_by_them(recordings, file, old, new, complaint, tmp_path):
    name = "late actuator, long windows"
    contents = sources(VARIANTS[name])
    assert contents[file].count(old.encode()) == 1
    contents[file] = contents[file].replace(old.encode(), new.encode())
    program, compared = branch_coverage.replay_program(name, tmp_path, SANITISERS, contents)
    done = replayed(program, compared, recordings[name][0], tmp_path)
    assert done.returncode != 0
    assert complaint in done.stderr


@pytest.mark.slow  # six libraries without optimisation, and gcovr
def test_every_branch_is_taken(recordings, tmp_path):
    found = branch_coverage.measured(recordings, tmp_path)
    assert found.missed == []
    assert found.branches > 300
    assert found.excluded == len(branch_coverage.EXCLUDED)


def test_a_branch_that_is_not_taken_is_seen(recordings, tmp_path):
    """With one variant alone, planning is never late, and no one doubts a sensor."""
    name = "classic, impatient"
    found = branch_coverage.measured({name: recordings[name]}, tmp_path)
    assert found.percent < 100.0
    assert found.missed
