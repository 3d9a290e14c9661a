"""Two commands never write to one place: a lock beside it says so, and goes with whoever holds it."""

import fcntl
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from contract.errors import OutputError
from stillwake.console.claims import claim, release
from stillwake.console.own_rooms import HOME

WRITING = (
    *("run PLACE", "run PLACE --overwrite", "campaign PLACE --quick", "train PLACE", "record PLACE.h5"),
    *("develop PLACE.npz --overwrite", "picture vorticity PLACE.png", "export --c PLACE", "can load --json PLACE.json"),
)
"""Of each kind one: what else writes goes through the same functions."""


@contextmanager
def held(place: Path) -> Iterator[None]:
    """As another process would."""
    with place.with_name(f".{place.name}.lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        file.write("process 123 on bench\n")
        file.flush()
        yield


@pytest.mark.slow  # every command that writes
def test_every_command_refuses_a_place_that_another_one_writes_to(cli, tmp_path):
    for words in WRITING:
        command = [word.replace("PLACE", str(tmp_path / "out")) for word in words.split()]
        place = next(Path(word) for word in command if "out" in word)
        with held(place):
            outcome = cli(*command)
        line = f"error: {place}: another command is writing there (process 123 on bench); wait until it has ended, or"
        assert (outcome.code, outcome.err) == (1, f"{line} name another place\n"), words
        assert [item.name for item in tmp_path.iterdir()] == [f".{place.name}.lock"], words
        place.with_name(f".{place.name}.lock").unlink()


def test_what_a_killed_one_left_is_taken_over_and_everything_goes_again(tmp_path):
    place = tmp_path / "new" / "deeper" / "out"
    for _ in range(2):
        claim(place, folder=True)
        claim(place, folder=True)  # twice by one command
        lock = place.parent / ".out.lock"
        assert re.fullmatch(rf"process {os.getpid()} on .+\n", lock.read_text())
        with lock.open() as file, pytest.raises(BlockingIOError):
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        release()
        assert list(tmp_path.iterdir()) == []
    place.parent.mkdir(parents=True)
    lock.write_text("process 1 on a machine that is no more\n")
    (tmp_path / "link").symlink_to(place)
    claim(tmp_path / "link")
    assert f"process {os.getpid()}" in lock.read_text()
    release()
    assert not lock.exists() and place.parent.is_dir()


@pytest.mark.processes
def test_of_two_at_once_one_is_refused_and_a_killed_one_holds_nothing(tmp_path):
    code = """
import sys
from pathlib import Path
from stillwake.console.claims import claim
claim(Path("out"))
print("has it", flush=True)
sys.stdin.read()
"""

    with subprocess.Popen(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(HOME)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as first:
        assert first.stdout is not None and first.stdout.readline() == "has it\n"
        with pytest.raises(OutputError, match=f"another command is writing there \\(process {first.pid} on"):
            claim(tmp_path / "out")
        first.send_signal(signal.SIGKILL)
        first.wait()
    claim(tmp_path / "out")
    release()
    assert list(tmp_path.iterdir()) == []
