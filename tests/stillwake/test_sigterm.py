"""Every long command as a process: it says how far it is where there is no terminal, and ends well on SIGTERM."""

import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import pytest

from stillwake.console.own_rooms import HOME
from tests.stillwake.commands.test_stopped import SMALL

pytestmark = pytest.mark.processes

VIRTUAL = ("--set", "bus.interface=virtual")
COARSE = ("--set", "flow.refinement=0.5")
"""A start from rest takes thousands of time steps before the first line of progress."""
PROGRESS = re.compile(r"\d+(/\d+)? \w+.* (so far|done in \d+ s)|^\d+ s: \d+ data frames", re.MULTILINE)
"""What `stillwake.console.progress.line_of` writes, and `can monitor`'s line a second."""
OF_LIBRARIES = (".ses", "torchinductor_")
"""What ONNX Runtime and PyTorch leave in the temporary folder for later processes, whenever they are loaded."""
PATIENCE_S = 240.0
"""The plant's kernels are compiled where no one has done it yet, on a machine that does other things."""


@dataclass(frozen=True, kw_only=True)
class Long:
    """A command, how it ends on SIGTERM, and what it may leave.

    Attributes:
        words: behind `python -m`.
        status: 143 where its work was not done; 0 where SIGTERM is how it is ended.
        leaves: names in its folder besides what was there; "?" stands behind those that need not be there yet.
    """

    words: tuple[str, ...]
    status: int = 143
    leaves: tuple[str, ...] = ()


def stillwake(*words: str, status: int = 143, leaves: tuple[str, ...] = ()) -> Long:
    return Long(words=("stillwake", *words), status=status, leaves=leaves)


def benchmarks(*words: str) -> Long:
    return Long(words=("benchmarks", *words))


COMMANDS = {
    "run": stillwake("run", "out", "--json", "out.json"),
    "run with faults": stillwake("run", "out", "--fault", "vehicle:drop:probability=0.1"),
    "record": stillwake("record", "out.h5", "--workers", "2", leaves=("out.h5.parts?",)),
    "record under": stillwake(
        "record", "out.h5", "--under", str(HOME / "firmware_sim/data/bundle"), leaves=("out.h5.parts?",)
    ),
    "train": stillwake("train", "out", *SMALL, leaves=("out.checkpoints?",)),
    "develop": stillwake("develop", "out.npz", *COARSE),
    "steady": stillwake("steady", "out.npz", "--json", "out.json", *COARSE),
    "animate": stillwake("animate", "out.gif"),
    "picture mean": stillwake("picture", "mean", "out.png", "--duration", "100"),
    "dataset import": stillwake(
        *("dataset", "import", "out.h5", "--sensors", "sensors.csv", "--period", "0.2", "--limit", "0.075"),
        *("--asymmetric", "--train", "long.log", "--forces", "forces.csv"),
    ),
    "can decode": stillwake("can", "decode", "long.log", "--summary", "--csv", "out.csv", "--json", "out.json"),
    "can monitor": stillwake("can", "monitor", *VIRTUAL, status=0),
    "can record": stillwake("can", "record", "out.log", *VIRTUAL, status=0, leaves=("out.log",)),
    "can replay": stillwake("can", "replay", "slow.log", *VIRTUAL),
    "can replay --loop": stillwake("can", "replay", "slow.log", "--loop", *VIRTUAL, status=0),
    "can send": stillwake("can", "send", "Pressure", "Valid0=1", "--count", "100000", *VIRTUAL),
    "bundle-fuzz": benchmarks("bundle-fuzz", "--workers", "2", "--json", "out.json"),
    "bus: processes": benchmarks("bus", "--part", "flips"),
    "bus": benchmarks("bus", "--part", "response_time"),
    "bus: another tool": benchmarks("bus", "--part", "gate_mutation"),
    "two-nodes": benchmarks("two-nodes", "virtual", "pty"),
    # The coarsest of the grids, and runs of some cycles: a line of progress comes with the first of them.
    "wake-speed": benchmarks("wake-speed", "--refinement", "0.7", "--rounds", "1000", "--json", "out.json"),
    "square": benchmarks("square", "--json", "out.json"),
    "open-loop": benchmarks("open-loop", "--controlled", "12", "--settle", "2", "--json", "out.json"),
}


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Logs that take long to read or to send, by their names."""
    frames = "".join(f"({t / 1000:.6f}) can0 7FF#00\n" for t in range(1_000_000))
    slow = "".join(f"({t / 2:.6f}) can0 7FF#00\n" for t in range(1000))
    sensors = "name,x,y,base\nupper_39,0.9,0.5,0\nlower_39,0.9,-0.5,0\nbase_0,1,0.4,1\nbase_9,1,-0.4,1\n"
    texts = {
        "long.log": frames,
        "slow.log": slow,
        "sensors.csv": sensors,
        "forces.csv": "t [t_c],Cd,Cl\n0,1,0\n1,1,0\n",
    }
    return {name: text.encode() for name, text in texts.items()}


@pytest.mark.parametrize("name", COMMANDS)
def test_sigterm_ends_it_with_one_line_no_file_and_no_process(
    name: str, tmp_path: Path, inputs: dict[str, bytes]
) -> None:
    command = COMMANDS[name]
    place, said = tmp_path / "place", tmp_path / "said"
    for folder in (place, said, tmp_path / "temporary"):
        folder.mkdir()
    for file, content in inputs.items():
        if file in command.words:
            (place / file).write_bytes(content)
    before = {path.name for path in place.iterdir()}
    environment = {**os.environ, "PYTHONPATH": f"{HOME}:{HOME / 'data'}", "TMPDIR": str(tmp_path / "temporary")}
    with (said / "out").open("wb") as out, (said / "err").open("wb") as err:
        process = subprocess.Popen(
            [sys.executable, "-m", *command.words],
            cwd=place,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=err,
            start_new_session=True,
        )
    try:
        _wait_for_progress(process, said)
        process.send_signal(signal.SIGTERM)
        process.wait(PATIENCE_S)
        text = (said / "err").read_text()
        assert process.returncode == command.status, text
        assert "Traceback" not in text + (said / "out").read_text()
        lines = text.splitlines()
        if command.status == 143:
            assert lines[-1].startswith("stopped"), text
        assert not any("error" in line.lower() for line in lines), text
        left = {path.name for path in place.iterdir()} - before
        sure = {name for name in command.leaves if not name.endswith("?")}
        assert sure <= left <= {name.removesuffix("?") for name in command.leaves}
        left = {path.name for path in (tmp_path / "temporary").iterdir()}
        assert [name for name in left if not name.startswith(OF_LIBRARIES)] == []
        _wait_for_the_last_of(process.pid)
    finally:
        for pid in (process.pid, *_session_of(process.pid)):
            try:
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                continue
        process.wait()


def _wait_for_progress(process: "subprocess.Popen[bytes]", said: Path) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while True:
        text = (said / "out").read_text() + (said / "err").read_text()
        if PROGRESS.search(text):
            return
        assert process.poll() is None, f"ended with {process.returncode} before a line of progress: {text}"
        assert time.monotonic() < deadline, f"no line of progress in {PATIENCE_S:g} s: {text}"
        time.sleep(0.05)


def _wait_for_the_last_of(session: int) -> None:
    # A worker that was killed is there until its own parent has looked, if only for a moment.
    deadline = time.monotonic() + 10.0
    while left := _session_of(session):
        assert time.monotonic() < deadline, {pid: Path(f"/proc/{pid}/cmdline").read_text() for pid in left}
        time.sleep(0.05)


def _session_of(leader: int) -> list[int]:
    """Living processes of a session; a group of its own within it is still of the session, unless it began another."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                state, _, _, session = (entry / "stat").read_text().rpartition(")")[2].split()[:4]
            except (FileNotFoundError, ProcessLookupError):
                continue
            if int(session) == leader and state != "Z":
                found.append(int(entry.name))
    return found
