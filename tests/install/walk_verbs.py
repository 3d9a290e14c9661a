"""Every command of an install works, or says in one line which extra it needs: run by `make pristine`, `make packages`.

    python -I tests/install/walk_verbs.py [EXTRA...]

The extras are those that are installed; with `sim`, `c` and `train` it is stillwake-data, too. It works in an empty
folder and refuses a stillwake that is not installed, so that no file of a checkout is used by accident. Ends with
status 1 and one line for the first command that does neither.
"""

import io
import os
import signal
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator, Sequence
from contextlib import chdir, redirect_stderr, redirect_stdout, suppress
from pathlib import Path
from threading import Event, Thread
from typing import Any

import typer.main

from contract.shipped import BUNDLE, RECORDING
from stillwake import __main__ as command_line

VIRTUAL = ("--set", "bus.interface=virtual", "--set", "bus.channel=walk")
UDP = ("--set", "bus.interface=udp_multicast", "--set", "bus.channel=239.74.163.9")
PAGE = "http://127.0.0.1:8769/"


class Call:
    """A command, by the words behind `stillwake`, with arguments that are as small as they may be; the extras without
    which it may refuse, and with which it has to work; and the status with which it ends then, 3 where no ECU answers.
    """

    def __init__(self, words: str, *more: object, needs: Sequence[str] = (), status: int = 0) -> None:
        self.words, self.needs, self.status = (*words.split(), *map(str, more)), needs, status


def write_inputs() -> None:
    """What the calls read and no command writes, into the working folder."""
    Path("drive.log").write_text("(1.0) can0 123#00\n(1.1) can0 130##1000102\n")
    Path("sensors.csv").write_text("name,x,y\ntop,0.0,0.5\nbottom,0.0,-0.5\n")
    rows = (f"{0.1 * (-1) ** (k // 9):g},1.{k % 7},0.{k % 5},-0.{k % 3},-0.{k % 4}\n" for k in range(60))
    Path("sweep.csv").write_text("action,Cd,Cl,top,bottom\n" + "".join(rows))
    Path("test.csv").write_text(Path("sweep.csv").read_text())


# In an order in which each finds what another one wrote.
CALLS = (
    Call("config mpc"),
    Call("keygen --secret access.key"),
    Call("keygen keys"),
    Call("bundle keylist keys.list --key keys/release.key --version 1 --allow keys/release.pub"),
    Call("bundle renew", BUNDLE, "renewed", "--name", "renewed", "--key", "keys/release.key", needs=["c"]),
    Call("bundle sign renewed --key keys/release.key", needs=["c"]),
    Call("bundle inspect", BUNDLE, "--trust", "project"),
    Call("bundle inspect --sbom release.cdx.json", needs=["c"]),
    Call("bundle diff", BUNDLE, BUNDLE),
    Call("ecu provision slots --root keys/release.pub --keys keys.list"),
    Call("ecu run --periods 3", *VIRTUAL),
    Call("ecu run --periods 3", *UDP, needs=["bus"]),
    Call("can send Pressure", *VIRTUAL, needs=["bus"]),
    Call("can decode drive.log"),
    Call("can monitor drive.log"),
    Call("can load"),
    Call("flash", BUNDLE, "--bus", "virtual:walk", "--access", "access.key", needs=["flash"]),
    Call("flash --keys keys.list --bus virtual:walk --access access.key", needs=["flash"]),
    Call("calibrate --bus virtual:walk --access access.key lift=0.2", needs=["flash"]),
    Call("diagnose --bus virtual:walk", needs=["flash"]),
    Call("export --for-testers testers"),
    # It runs until it is stopped: here it refuses a library that is not there.
    Call("ecu --mcu flash.bin --library none --root keys/release.pub --access access.key", *UDP, status=1),
    Call("run run --lead-in 14 --controlled 1 --no-averages", needs=["sim"]),
    Call("run run_in_c --ecu c", needs=["sim", "c"]),
    Call("report run --output run.png", needs=["sim"]),
    Call("record made.h5 training=5 chirp=0 uncontrolled=5 --workers 1", needs=["sim"]),
    Call("dataset inspect", RECORDING, needs=["sim"]),
    Call(
        "dataset import own.h5 train=sweep.csv test=test.csv --layout sensors.csv --set flow.control_period=0.2 --set "
        "flow.action_limit=0.1",
        needs=["sim"],
    ),
    Call("picture pressure.pdf --field pressure", needs=["sim"]),
    Call("picture mean.svg --field mean --duration 1", needs=["sim"]),
    Call("picture run.gif --forcing run --every 10", needs=["sim"]),
    Call("develop start.npz --duration 0.2", needs=["sim"]),
    Call("plant-fmu plant.fmu", needs=["sim", "fmu"]),
    Call("develop steady.npz --steady --set flow.refinement=0.4", needs=["sim"]),
    Call("vehicle --periods 3", *VIRTUAL, needs=["sim"], status=3),
    Call("campaign --list", needs=["sim"]),
    Call("latency latency --periods 100", needs=["sim"]),
    Call("train model", needs=["train"]),
    Call("export --c library", needs=["c"]),
    Call("mcu", needs=["c", "mcu"]),
    Call("refine refined --set refine.updates=1", needs=["sim", "train"]),
    Call("live --port 8769 --plant recording", needs=["sim"]),
)


def verbs(command: Any, above: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    for name, inner in command.commands.items():
        if hasattr(inner, "commands"):
            yield from verbs(inner, (*above, name))
        else:
            yield (*above, name)


def stop_when_answered(called: Event) -> None:
    """Send this process SIGTERM, once the page of `live` and its script are there."""
    while not called.wait(0.2):
        with suppress(OSError):
            for name in ("", "static/live.js"):
                urllib.request.urlopen(PAGE + name, timeout=5.0).read()
            os.kill(os.getpid(), signal.SIGTERM)
            return


def ended(words: Sequence[str]) -> tuple[int, str]:
    """Exit status and stderr of `stillwake` with these words, in this process."""
    out, err, over = io.StringIO(), io.StringIO(), Event()
    sys.argv = ["stillwake", *words]
    if words[0] == "live":
        Thread(target=stop_when_answered, args=(over,), daemon=True).start()
    with redirect_stdout(out), redirect_stderr(err):
        try:
            command_line.main()
        except SystemExit as stop:
            return int(stop.code or 0), err.getvalue()
        finally:
            over.set()
    raise AssertionError("a command line that does not exit")


def wrong(one: Call, installed: Sequence[str], status: int, err: str) -> str | None:
    lacking = [extra for extra in one.needs if extra not in installed]
    # What an extra brings may have come with another one.
    if status == one.status or not lacking:
        return None if status == one.status else f"status {status}: {err.strip()}"
    named = [extra for extra in lacking if f"pip install '.[{extra}]'" in err]
    if status == 1 and err.startswith("error: ") and err.count("\n") == 1 and named:
        return None
    return f"status {status}, and no single line that names {' or '.join(lacking)}: {err.strip()}"


def main(installed: Sequence[str]) -> None:
    if "site-packages" not in Path(command_line.__file__).parts:
        sys.exit(f"{command_line.__file__}: a checkout; this is for an install")
    known = set(verbs(typer.main.get_command(command_line.app)))
    called = {one.words[:size] for one in CALLS for size in (1, 2)} & known
    if known != called:
        sys.exit(f"no call of {', '.join(sorted(' '.join(verb) for verb in known - called))}")
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as folder, chdir(folder):
        write_inputs()
        for one in CALLS:
            before = time.monotonic()
            status, err = ended(one.words)
            trouble = wrong(one, installed, status, err)
            if trouble is not None:
                sys.exit(f"stillwake {' '.join(one.words)}: {trouble}")
            sys.stderr.write(f"{time.monotonic() - before:6.1f} s  {' '.join(one.words)}\n")
    extras = ", ".join(installed) or "no extra"
    sys.stdout.write(f"{len(CALLS)} calls of {len(known)} commands with {extras}: {time.monotonic() - began:.0f} s\n")


if __name__ == "__main__":
    main(sys.argv[1:])
