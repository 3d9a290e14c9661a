"""The recorder among real processes, with the real plant: killed, interrupted, side by side."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

from contract.config.tree import Config
from contract.recording.dataset import Dataset, read
from tests.wake.recording.killing import equal
from wake.recording.episode_plan import EpisodePlan
from wake.recording.recorder import record

pytestmark = pytest.mark.processes

ROOT = Path(__file__).resolve().parents[3]
PLANS = (EpisodePlan(forcing="training", steps=9, seed=5, lead=1), EpisodePlan(forcing="none", steps=4, seed=0))
BLOCK_STEPS = 2


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Dataset:
    """Recorded in this process, in one go."""
    path = tmp_path_factory.mktemp("whole") / "whole.h5"
    record(path, PLANS, Config(), block_steps=BLOCK_STEPS)
    return read(path)


def is_worker(process: psutil.Process) -> bool:
    """By its command line; where setproctitle is installed, a worker of dask names itself."""
    try:
        title = " ".join(process.cmdline())
    except psutil.NoSuchProcess:
        # Also one that has ended and was not waited for yet.
        return False
    return "spawn_main" in title or "dask worker" in title


def test_side_by_side_with_a_worker_killed_gives_the_same(tmp_path, whole):
    output = tmp_path / "a.h5"
    notices: list[str] = []
    victims: list[psutil.Process] = []

    def kill_one(name: str, done: int, total: int) -> None:
        if done and not victims:
            victims.append(next(filter(is_worker, psutil.Process().children(recursive=True))))
            victims[0].kill()

    record(output, PLANS, Config(), block_steps=BLOCK_STEPS, workers=2, progress=kill_one, notice=notices.append)
    assert equal(read(output), whole)
    assert any("was lost" in line for line in notices)
    assert not (tmp_path / "a.h5.parts").exists()


def _command(*arguments: object, scratch: Path | None = None) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "stillwake", "record", *map(str, arguments), "--workers", "2"],
        cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        env=os.environ | ({} if scratch is None else {"TMPDIR": str(scratch)}),
    )  # fmt: skip


def test_a_signal_to_the_group_ends_the_workers_too(tmp_path):
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    with _command(tmp_path / "a.h5", scratch=scratch) as process:
        workers: list[psutil.Process] = []
        while len(workers) < 2 and process.poll() is None:
            time.sleep(0.1)
            children = psutil.Process(process.pid).children(recursive=True)
            workers = [child for child in children if is_worker(child)]
        os.killpg(process.pid, signal.SIGTERM)
        out, err = process.communicate()
    # No warning of leaked semaphores, and nothing recorded yet that could be continued.
    assert (process.returncode, err) == (143, "stopped\n")
    assert "wrote" not in out
    assert psutil.wait_procs(workers, timeout=20)[1] == []
    assert list(tmp_path.rglob("*")) == [scratch]


def test_a_workers_error_is_one_line(tmp_path):
    steps = ("--training", 20, "--chirp", 0, "--uncontrolled", 20)
    with _command(tmp_path / "a.h5", *steps, "--set", "flow.substeps=3") as process:
        err = process.communicate()[1]
    assert process.returncode == 1
    assert err.startswith("error: dt = 0.0667") and err.count("\n") == 1
    assert not (tmp_path / "a.h5").exists()
