"""However a command ends early: one line, a status, nothing half-written and no process left.

The long commands are stopped in this process, at their first progress or frame, and those that write find no room on
the disk. A limit on the size of files stands in for a full disk.
"""

import re
import resource
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from can.interfaces.virtual import VirtualBus
from rich.progress import Progress

from stillwake.console import stopping

SMALL = tuple(
    word
    for setting in (
        *("model.lstm_width=4", "model.dynamics_width=4", "model.decoder_width=4", "model.window=8"),
        *("train.batch_size=16", "train.segment=1", "train.epochs=100"),
    )
    for word in ("--set", setting)
)
COARSE = ("--set", "flow.refinement=0.4", "--set", "flow.substeps=12")
VIRTUAL = ("--set", "bus.interface=virtual")
STOPPED = {
    "run out --json out.json": 143,
    f"train out --dataset {{recording}} {' '.join(SMALL)}": 143,
    f"develop out.npz --steady --json out.json {' '.join(COARSE)}": 143,
    "picture out.gif": 143,
    "dataset import out.h5 train=long.log --layout sensors.csv --asymmetric --forces forces.csv "
    "--set flow.control_period=0.2 --set flow.action_limit=0.075": 143,
    "can decode long.log --summary --csv out.csv --json out.json": 143,
    f"can monitor {' '.join(VIRTUAL)}": 0,
    f"vehicle --priority 0 {' '.join(VIRTUAL)}": 3,
    f"ecu {{release}} --priority 0 {' '.join(VIRTUAL)}": 0,
    f"can send Pressure Valid0=1 --count 100000 {' '.join(VIRTUAL)}": 143,
}
"""Commands that take long, and how they end on SIGTERM: 0 where it is how they are ended, 3 where no ECU answered."""
NO_ROOM = {
    "can decode long.log --summary --csv out.csv": "out.csv",
    "can load --json out.json": "out.json",
    f"develop out.npz --duration 0.2 {' '.join(COARSE)}": "out.npz",
    "record out.h5 training=8 chirp=0 uncontrolled=0 --workers 1": "out.h5",
    "picture out.png": "out.png",
    "picture out.gif --duration 0.4": "out.gif",
    "run out --bundle {release} --lead-in 0.4 --controlled 0.4 --no-averages": "out/",
}
"""Commands that write, and what the line on a full disk names."""
INPUTS = {
    "long.log": "".join(f"({t / 1000:.6f}) can0 7FF#00\n" for t in range(30_000)),
    "sensors.csv": "name,x,y,base\nupper_39,0.9,0.5,0\nlower_39,0.9,-0.5,0\nbase_0,1,0.4,1\nbase_9,1,-0.4,1\n",
    "forces.csv": "t [t_c],Cd,Cl\n0,1,0\n1,1,0\n",
}


@pytest.fixture
def place(tmp_path, monkeypatch) -> Iterator[Path]:
    """A working folder with the inputs; afterwards signals do again what they did."""
    for name, text in INPUTS.items():
        (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    before = signal.getsignal(signal.SIGTERM)
    yield tmp_path
    stopping.outcome()  # forgets a SIGTERM after which the command ended well
    signal.signal(signal.SIGTERM, before)


@contextmanager
def stop_at_first_work() -> Iterator[list[bool]]:
    """Send SIGTERM once, at the first progress or frame; what is yielded is then not empty."""
    sent: list[bool] = []

    def stop_before(work: Callable[..., Any]) -> Callable[..., Any]:
        def stopped(*arguments: Any, **options: Any) -> Any:
            if not sent:
                sent.append(True)
                signal.raise_signal(signal.SIGTERM)
            return work(*arguments, **options)

        return stopped

    with pytest.MonkeyPatch.context() as patch:
        for kind, method in ((Progress, "update"), (VirtualBus, "_recv_internal"), (VirtualBus, "send")):
            patch.setattr(kind, method, stop_before(getattr(kind, method)))
        yield sent


@pytest.mark.slow  # loads the flow solver and torch, and begins the work of every long command
def test_a_stop_is_one_line_and_leaves_nothing(cli, place, short_recording, short_release) -> None:
    """On SIGTERM; `console/test_stopping.py` compares it with Ctrl-C."""
    for words, status in STOPPED.items():
        with stop_at_first_work() as sent:
            outcome = cli(*words.format(recording=short_recording, release=short_release).split())
        assert sent and outcome.code == status, (words, outcome)
        if status == 143:
            assert re.fullmatch(r"stopped(; .*)?\n", outcome.err), (words, outcome.err)
        assert "Traceback" not in outcome.out + outcome.err, words
        assert {path.name for path in place.iterdir()} == set(INPUTS), words


@pytest.mark.slow  # a closed loop and a recording, if short ones
def test_a_full_disk_is_one_line_and_leaves_nothing(cli, place, short_release) -> None:
    for words, named in NO_ROOM.items():
        soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (50, hard))
        try:
            outcome = cli(*words.format(release=short_release).split())
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        assert outcome.code == 1, (words, outcome)
        assert re.fullmatch(rf"error: .*{named}.*File too large\n", outcome.err), (words, outcome.err)
        assert {path.name for path in place.iterdir()} == set(INPUTS), words
