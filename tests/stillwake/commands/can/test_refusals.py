"""What no bus command can do is one line that names the value, and nothing is sent or written."""

from collections.abc import Callable
from pathlib import Path

import can

from tests.stillwake.commands.can.virtual_bus import VIRTUAL, taken, write

DECODE = {
    "empty.log": "empty.log: holds no CAN frame",
    "cut.blf": "cut.blf: ",
    "good.log --csv good.log": "is the file to read",
    "good.log --csv folder": "it is a directory",
    "good.log --json folder": "it is a directory",
    "good.log --set bus.interface=virtual": "`can decode` does not use it",
}
LOAD = {
    "--set bus.background.dbc=none.dbc": "none.dbc: No such file or directory",
    "--set bus.interface=virtual": "--set bus.interface: `can load` does not use it",
    "--set bus.background.load=0.00001": "must be at least one message per second",
}
MONITOR = {
    "empty.log": "empty.log: holds no CAN frame",
    "": "that bus exists only within a run",
    "empty.log --for 2": "--for: needs a bus",
    "--for inf": "--for inf: must be a number above 0",
    "--set bus.interface=nonsense": "nonsense",
}
SEND = {
    "Pressure Pressure0=1e9": "smaller than or equal to 3276.7",
    "Pressures": "other frames, from a log",
    "PressureSecured": "name its key with --set bus.key=FILE",
    "PressureSecured --set bus.key=key.bin": "name its power cycle with --trip",
    "PressureSecured --trip 2 --set bus.key=no.bin": "no.bin: cannot read the key",
    "Pressure --trip 2": "Pressure has no freshness value",
    "Pressure --set bus.key=key.bin": "is sent without authentication",
    "PressureClassic --counter 16": "--counter 16: must be in 0..15 for PressureClassic",
    "Pressure --period nan": "--period nan: must be a number above 0",
    "Pressure --set bus.interface=simulated": "that bus exists only within a run",
    "Pressure --set ecu.delay_steps=1": "`can send` does not use it",
}


def test_each_is_one_line(all_refused: Callable[..., None], peer: can.BusABC, tmp_path: Path) -> None:
    write(tmp_path / "good.log", 1)
    write(tmp_path / "cut.blf", 100)
    (tmp_path / "cut.blf").write_bytes((tmp_path / "cut.blf").read_bytes()[:-100])
    (tmp_path / "empty.log").touch()
    (tmp_path / "folder").mkdir()
    all_refused("can decode --summary", DECODE)
    all_refused("can load", LOAD)
    all_refused("can monitor", MONITOR)
    all_refused(("can", "send", *VIRTUAL), SEND)
    assert taken(peer) == []
