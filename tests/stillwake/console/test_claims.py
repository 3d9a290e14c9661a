"""Two commands never write to one place: a lock beside it says so, and goes with whoever holds it."""

import fcntl
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from contract.errors import OutputError
from stillwake.console.outputs import claim, release
from stillwake.console.start import HOME

WRITING = (
    *("run PLACE", "run PLACE --overwrite", "campaign PLACE", "train PLACE", "record PLACE.h5"),
    *("develop PLACE.npz --overwrite", "picture PLACE.png", "export --c PLACE", "can load --json PLACE.json"),
    *("report RUN --output PLACE.csv", "report RUN RUN --output PLACE.html"),
    "dataset inspect DATA --picture PLACE.png",
)
"""Of each kind one: what else writes goes through the same functions."""
HOLDER = """
import sys
from pathlib import Path
from stillwake.console.outputs import claim
claim(Path("out"))
print("has it", flush=True)
sys.stdin.read()
"""


@pytest.mark.slow  # every kind of command
def test_every_command_refuses_a_place_that_another_one_writes_to(cli, tmp_path, short_recording):
    places = {"PLACE": str(tmp_path / "out"), "RUN": str(short_recording.parent), "DATA": str(short_recording)}
    for words in WRITING:
        command = words.split()
        for name, meant in places.items():
            command = [word.replace(name, meant) for word in command]
        place = next(Path(word) for word in command if word.startswith(places["PLACE"]))
        lock = place.with_name(f".{place.name}.lock")
        with lock.open("w", buffering=1) as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            file.write("process 123 on bench\n")
            outcome = cli(*command)
        line = f"error: {place}: another command is writing there (process 123 on bench); wait until it has ended, or"
        assert (outcome.code, outcome.err) == (1, f"{line} name another place\n"), words
        assert list(tmp_path.iterdir()) == [lock], words
        lock.unlink()


@pytest.mark.processes
def test_one_of_two_has_it_and_a_killed_one_holds_nothing(tmp_path):
    place = tmp_path / "new" / "deeper" / "out"
    for _ in range(2):
        claim(place, folder=True)
        claim(place, folder=True)  # twice by one command
        lock = place.parent / ".out.lock"
        assert re.fullmatch(rf"process {os.getpid()} on .+\n", lock.read_text())
        release()
        assert list(tmp_path.iterdir()) == []
    environment = {**os.environ, "PYTHONPATH": str(HOME)}
    with subprocess.Popen(
        [sys.executable, "-c", HOLDER], cwd=tmp_path, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as holder:
        assert holder.stdout is not None and holder.stdout.readline() == b"has it\n"
        (tmp_path / "link").symlink_to("out")
        for path in ("out", "link"):
            with pytest.raises(OutputError, match=f"another command is writing there \\(process {holder.pid} on"):
                claim(tmp_path / path)
        holder.kill()
        holder.wait()
    assert (tmp_path / ".out.lock").exists()
    claim(tmp_path / "out")
    release()
    assert [item.name for item in tmp_path.iterdir()] == ["link"]


def test_where_the_system_has_no_locks_nothing_is_refused(tmp_path, monkeypatch):
    """As on Windows, whose Python has no fcntl."""
    monkeypatch.setitem(sys.modules, "fcntl", None)
    claim(tmp_path / "out")
    release()
    assert list(tmp_path.iterdir()) == []
