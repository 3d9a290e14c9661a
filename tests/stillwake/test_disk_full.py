"""A disk that is full in the middle of the work: one line that names the file, and nothing half-written.

A limit on the size of files stands in for it: writing then fails as on a full disk, without a file
system of its own.
"""

import os
import resource
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from stillwake.console.own_rooms import HOME

pytestmark = pytest.mark.processes

QUICK = ("--lead-in", "4", "--controlled", "1", "--no-averages")
"""Some ten thousand bytes of frames."""


def limited(place: Path, largest: int, *words: str) -> "subprocess.CompletedProcess[str]":
    def limit() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (largest, largest))

    environment = {**os.environ, "PYTHONPATH": f"{HOME}:{HOME / 'data'}", "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-m", "stillwake", *words]
    return subprocess.run(
        command,
        cwd=place,
        env=environment,
        preexec_fn=limit,
        capture_output=True,
        text=True,
        timeout=240.0,
        check=False,
    )


@pytest.mark.parametrize(("largest", "file"), [(500, "frames.log"), (6000, "out/")])
def test_a_run_whose_log_has_no_room(tmp_path: Path, short_release: Path, largest: int, file: str) -> None:
    done = limited(tmp_path, largest, "run", "out", "--bundle", str(short_release), *QUICK)
    assert done.returncode == 1
    assert done.stderr.startswith("error: cannot write out/") and done.stderr.count("\n") == 1, done.stderr
    assert file in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_table_that_has_no_room(tmp_path: Path) -> None:
    log = tmp_path / "long.log"
    log.write_text("".join(f"({t / 1000:.6f}) can0 7FF#00\n" for t in range(5000)))
    done = limited(tmp_path, 10_000, "can", "decode", "long.log", "--summary", "--csv", "out.csv")
    assert done.returncode == 1
    assert done.stderr == "error: cannot write out.csv: File too large\n"
    assert [path.name for path in tmp_path.iterdir()] == ["long.log"]


def test_figures_that_have_no_room(tmp_path: Path) -> None:
    done = limited(tmp_path, 100, "can", "load", "--json", "out.json")
    assert done.returncode == 1
    assert done.stderr == "error: cannot write out.json: File too large\n"
    assert list(tmp_path.iterdir()) == []
