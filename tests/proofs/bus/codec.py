"""What it costs to write and read a message, compared with cantools and the same DBC.

Values to bytes and back without the E2E header, which cantools does not know either. Both sides get the same values,
and their bytes are compared before anything is timed. cantools is given what makes it fastest: the message at hand,
numbers for choices, no checks for missing or superfluous signals.
"""

from collections.abc import Callable
from importlib.resources import files
from statistics import median
from timeit import Timer
from typing import Any, Final

from cantools.database import Database
from cantools.database.can import Message as Described

from can_bridge.wire.message_sets import SETS, Message
from can_bridge.wire.messages import EcuStatus, JetCommand, Mode, Pressure, Reason

CALLS: Final = 500
"""In one timing."""

_PRESSURE: Final = Pressure(pressure_pa=(-212.0, -187.0, 35.0, -71.0), valid=(True,) * 4, enable_request=True, age_ns=0)
_COMMAND: Final = JetCommand(flow_m2_per_s=-2.3412, mode=Mode.CONTROL, enable=True, pressure_counter=11)
_STATUS: Final = EcuStatus(
    state=Mode.CONTROL,
    reason=Reason.NONE,
    overruns=3,
    missed=2,
    crc_errors=1,
    refused=4,
    bus_off=0,
    bundle_hash=0xD3060000,
)


def measure(*, repeats: int = 21, progress: Callable[[int, int], None] = lambda done, total: None) -> dict[str, Any]:
    """Medians over the repeats, ours and theirs in turn.

    Returns:
        codec_times_cantools: how many times faster, the smallest ratio over messages and directions.
        rows: one for each message and direction with both times in us.
    """
    dbc = Database()
    dbc.add_dbc_string(files("contract").joinpath("stillwake.dbc").read_text())
    pairs: list[tuple[str, str, Timer, Timer]] = []
    for messages in SETS[:2]:
        # The authenticated set has the codec of the plain one.
        for message, value in (
            (messages.pressure, _PRESSURE),
            (messages.command, _COMMAND),
            (messages.status, _STATUS),
        ):
            pairs += _timers(message, value, dbc.get_message_by_name(message.spec.name))
    times: list[tuple[list[float], list[float]]] = [([], []) for _ in pairs]
    for done in range(repeats):
        for (_, _, ours, theirs), (our_times, their_times) in zip(pairs, times, strict=True):
            our_times.append(ours.timeit(CALLS) / CALLS * 1e6)
            their_times.append(theirs.timeit(CALLS) / CALLS * 1e6)
        progress(done + 1, repeats)
    rows: list[dict[str, Any]] = [
        {
            "message": name,
            "direction": direction,
            "stillwake_us": median(our_times),
            "cantools_us": median(their_times),
            "ratio": median(their_times) / median(our_times),
        }
        for (name, direction, _, _), (our_times, their_times) in zip(pairs, times, strict=True)
    ]
    return {"codec_times_cantools": min(row["ratio"] for row in rows), "rows": rows}


def _timers(message: Message[Any], value: Any, described: Described) -> list[tuple[str, str, Timer, Timer]]:
    """Writing and reading, ours and theirs."""
    name, data = message.spec.name, message.emit(value)
    # cantools names a value outside a table by a text, and its numbers are those it reads back.
    signals = described.decode(data, decode_choices=False)
    if described.encode(signals) != data or message.parse(data) != value:
        raise ValueError(f"{name}: stillwake and cantools do not write and read the same")
    return [
        (name, "write", Timer(lambda: message.emit(value)), Timer(lambda: described.encode(signals, strict=False))),
        (name, "read", Timer(lambda: message.parse(data)), Timer(lambda: described.decode(data, decode_choices=False))),
    ]
