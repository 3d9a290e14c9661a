"""What it costs to write and read a message, compared with cantools and the same DBC.

Values to bytes and back without the E2E header, which cantools does not know either. Both sides get the same values,
and their bytes are compared before anything is timed. cantools is given what makes it fastest: the message at hand,
numbers for choices, no checks for missing or superfluous signals.
"""

from collections.abc import Iterator
from importlib.resources import files
from statistics import median
from timeit import Timer
from typing import Any, Final

from cantools.database import Database

from can_bridge.wire.message_sets import SETS, Message
from can_bridge.wire.messages import EcuStatus, JetCommand, Mode, Pressure, Reason
from tests.proofs.command_line import track

CALLS: Final = 500
"""Calls in one timing."""
_VALUES: Final[tuple[Any, ...]] = (
    Pressure(pressure_pa=(-212.0, -187.0, 35.0, -71.0), valid=(True,) * 4, enable_request=True, age_ns=0),
    JetCommand(flow_m2_per_s=-2.3412, mode=Mode.CONTROL, enable=True, pressure_counter=11),
    EcuStatus(Mode.CONTROL, Reason.NONE, 3, 2, 1, bus_off=0, bundle_hash=0xD3060000, refused=4),
)


def measure(*, repeats: int = 21) -> dict[str, Any]:
    """Medians over the repeats, ours and theirs in turn.

    Returns:
        codec_times_cantools: how many times faster, the smallest ratio over messages and directions.
        rows: one for each message and direction with both times in us.
    """
    dbc = Database()
    dbc.add_dbc_string(files("contract").joinpath("stillwake.dbc").read_text())
    # The authenticated set has the codec of the plain one.
    messages: list[Message[Any]] = [one for plain in SETS[:2] for one in (plain.pressure, plain.command, plain.status)]
    pairs = [
        pair
        for message, value in zip(messages, 2 * _VALUES, strict=True)
        for pair in _timers(message, value, dbc.get_message_by_name(message.spec.name))
    ]
    times: list[tuple[list[float], list[float]]] = [([], []) for _ in pairs]
    for _ in track(range(repeats), "codec", "repeats"):
        for (_, _, *timers), both in zip(pairs, times, strict=True):
            for timer, taken in zip(timers, both, strict=True):
                taken.append(timer.timeit(CALLS) / CALLS * 1e6)
    rows: list[dict[str, Any]] = []
    for (name, direction, *_), both in zip(pairs, times, strict=True):
        ours, theirs = map(median, both)
        named = {"message": name, "direction": direction}
        rows.append({**named, "stillwake_us": ours, "cantools_us": theirs, "ratio": theirs / ours})
    return {"codec_times_cantools": min(row["ratio"] for row in rows), "rows": rows}


def _timers(message: Message[Any], value: Any, described: Any) -> Iterator[tuple[str, str, Timer, Timer]]:
    """Writing and reading, ours and theirs."""
    name, data = message.spec.name, message.emit(value)
    # cantools names a value outside a table by a text, and its numbers are those it reads back.
    signals = described.decode(data, decode_choices=False)
    if described.encode(signals) != data or message.parse(data) != value:
        raise ValueError(f"{name}: stillwake and cantools do not write and read the same")
    yield name, "write", Timer(lambda: message.emit(value)), Timer(lambda: described.encode(signals, strict=False))
    yield name, "read", Timer(lambda: message.parse(data)), Timer(lambda: described.decode(data, decode_choices=False))
