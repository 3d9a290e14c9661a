"""The recorder among real processes, with the real plant: killed, interrupted, side by side."""

import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path
from typing import Any

import psutil
import pytest

from contract.config.tree import Config
from contract.recording.dataset import Dataset, read
from contract.release.bundle import load
from ecu.bundle_policy import BundlePolicy
from tests.wake.conftest import equal
from wake.recording.plans import ControlledRound
from wake.recording.recorder import record_round

pytestmark = pytest.mark.processes


def is_worker(process: psutil.Process) -> bool:
    """By its command line; where setproctitle is installed, a worker of dask names itself."""
    try:
        title = " ".join(process.cmdline())
    except psutil.NoSuchProcess:
        # Also one that has ended and was not waited for yet.
        return False
    return "spawn_main" in title or "dask worker" in title


@pytest.mark.proofs  # three processes; test_stops.py stops every command in one
def test_a_signal_to_the_group_ends_the_workers_too(tmp_path):
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    with subprocess.Popen(
        [sys.executable, "-m", "stillwake", "record", str(tmp_path / "a.h5"), "--workers", "2"],
        cwd=Path(__file__).parents[3], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        start_new_session=True, env=os.environ | {"TMPDIR": str(scratch)},
    ) as process:  # fmt: skip
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


@pytest.mark.proofs  # fifteen seconds of the real plant in three processes
def test_side_by_side_under_a_release_with_a_worker_killed_gives_the_same(tmp_path, short_release):
    release = load(short_release)
    # Longer than the window, so that the controller acts; and a seed whose leads are 1 and 0 steps.
    names: dict[str, Any] = {"bundle": "none", "bundle_digest": "0" * 64}
    planned = ControlledRound(episodes=2, steps=18, exploration=0.1, seed=22, **names)
    notices: list[str] = []
    victims: list[psutil.Process] = []

    def kill_one(name: str, done: int, total: int) -> None:
        if done and not victims:
            victims.append(next(filter(is_worker, psutil.Process().children(recursive=True))))
            victims[0].kill()

    def recorded(name: str, **options: Any) -> Dataset:
        policy = partial(BundlePolicy, release)
        record_round(tmp_path / name, planned, Config(), policy, block_steps=1, notice=notices.append, **options)
        return read(tmp_path / name)

    one, two = recorded("one.h5"), recorded("two.h5", workers=2, progress=kill_one)
    assert equal(one, two)
    assert any("was lost" in line for line in notices)
    assert sorted(item.name for item in tmp_path.iterdir()) == ["one.h5", "two.h5"]
