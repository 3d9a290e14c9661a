"""The commands for single frames: `stillwake can send|decode`."""

import csv
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer
from rich.box import SIMPLE_HEAD
from rich.table import Column, Table

from contract.atomic import replacing
from contract.errors import BusError, ConfigError
from stillwake.console import options as shared
from stillwake.console.outputs import check_json, check_output, save_json
from stillwake.console.progress import progress
from stillwake.console.settings import DIAGNOSIS, settings, with_bus
from stillwake.console.stopping import until_stopped
from stillwake.console.terminal import console, listed

if TYPE_CHECKING:
    from can_bridge.logs.log_reader import CanLog
    from can_bridge.secoc.key import Key
    from can_bridge.tools.traffic import Summary, Traffic
    from can_bridge.wire.frame import Frame
    from contract.config.vehicle import BusConfig

BUS: Final = ("bus.interface", "bus.channel", "bus.frames", "bus.nominal_bitrate", "bus.data_bitrate")
"""Settings for the connection to a bus."""

Channel = Annotated[str | None, typer.Option(help="Name of a channel in the log.", metavar="NAME", show_default=False)]
Trip = Annotated[
    int | None,
    typer.Option(help="Number of power cycles for secured messages.", min=1, max=0xFFFFFFFF, show_default=False),
]


def key_of(file: str) -> "Key | None":
    """Return the key in the file of `bus.key`; None if `bus.key` is empty. Raises KeyFileError as `read_key` does."""
    from can_bridge.secoc.key import read_key

    return read_key(Path(file)) if file else None


def send(
    message: Annotated[str, typer.Argument(help="Message, by its name in the DBC, e.g. Pressure.", show_default=False)],
    values: Annotated[list[str] | None, typer.Argument(help="SIGNAL=VALUE; signals that are left out are 0.")] = None,
    count: Annotated[int, typer.Option(help="Number of frames to send.", min=1)] = 1,
    period: Annotated[float, typer.Option(help="Seconds between two frames.")] = 0.02,
    counter: Annotated[int, typer.Option(help="E2E counter of the first frame.", min=0, max=255)] = 0,
    trip: Trip = None,
    bus: shared.Bus = None,
    given: shared.Settings = [],  # noqa: B006
) -> None:
    """Send one of stillwake's messages, with its E2E header.

    A value that does not fit its signal is refused. A receiver uses a message only after several good frames in a row:
    see --count. Messages of the secured set are signed with bus.key and with --trip, a number of power cycles. This
    number must be larger than every number that was used with this key. After a receiver has accepted such messages, it
    rejects the frames of the original sender until the sender's own number of power cycles exceeds --trip. To send
    other frames, use python-can: `python -m can.player` sends the frames of a log.

    stillwake can send Pressure Pressure0=-12.5 Valid0=1 --bus socketcan:can0
    """
    from can_bridge.bus.backends.connection import open_bus

    config = settings("can send", with_bus(bus, given), uses=(*BUS, "bus.key")).config.bus
    shared.positive("--period", period)
    stamped = _frames(message, values or [], counter, trip, config)
    sent = 0
    with open_bus(config) as opened, until_stopped() as is_stopped, progress("rounds") as report:
        begin = time.monotonic()
        while sent < count and not is_stopped():
            if (left := begin + sent * period - time.monotonic()) > 0:
                time.sleep(min(left, 0.2))
                continue
            opened.send_frame(stamped(time.time()))
            sent += 1
            if count > 1:
                report("sending", sent, count)
    console.print(f"sent {sent} frame{'' if sent == 1 else 's'}")
    if sent < count:
        raise KeyboardInterrupt


def _frames(
    name: str, values: list[str], counter: int, trip: int | None, config: "BusConfig"
) -> "Callable[[float], Frame]":
    """Return a function that builds the next frame to send; the function's argument is the frame's time stamp in s."""
    from can_bridge.e2e.profiles import E2eSender, SenderState, profile_of
    from can_bridge.secoc.securing import Freshness, secured
    from can_bridge.tools.signals import encode

    spec, data = encode(name, values)
    if spec.is_fd and config.frames == "classic":
        raise ConfigError(f"bus.frames = classic: {name} is a CAN FD message; use a message ending in Classic")
    if spec.is_secured:
        if not config.key:
            raise BusError(f"{name} is sent with an authentication code; give the key with --set bus.key=FILE")
        if trip is None:
            larger = "a number of power cycles larger than any number used with the key"
            raise ConfigError(f"{name} is signed with a freshness value; give --trip, {larger}")
    elif trip is not None:
        raise ConfigError(f"--trip {trip}: {name} has no freshness value; use a message ending in Secured")
    elif config.key:
        remedy = "with a key, use a message ending in Secured"
        raise ConfigError(f"bus.key: {name} is sent without authentication; {remedy}")
    last = profile_of(spec).counter_period - 1
    if counter > last:
        raise ConfigError(f"--counter {counter}: must be in 0..{last} for {name}")
    sender, key, freshness = E2eSender(spec), key_of(config.key), Freshness(trip=trip or 1)
    sender.state = SenderState(counter=counter)

    def made(now_s: float) -> "Frame":
        nonlocal freshness
        frame = sender.frame(data, now_ns=round(now_s * 1e9))
        frame = secured(frame, spec=spec, key=key, freshness=freshness)
        freshness = freshness.next()
        return frame

    return made


CsvFile = Annotated[
    Path | None, typer.Option("--csv", help="Also write a new CSV file with a row for each signal.", metavar="FILE")
]


def decode(
    file: Annotated[Path, typer.Argument(help="Log of any kind (docs/how-to/use-a-real-bus.md).", show_default=False)],
    summary: Annotated[bool, typer.Option("--summary", help="Print only the tables at the end.")] = False,
    csv_file: CsvFile = None,
    channel: Channel = None,
    json_file: shared.JsonFile = None,
    given: shared.Settings = [],  # noqa: B006
) -> None:
    """Print the frames of a recorded log as signals with units, and the results of the frames' end-to-end checks.

    The command prints a line for each frame. Then it prints a table of the messages with counts, rates, losses and
    check results. It also prints the bus load, computed from the bit rates in the settings, and the number of lines
    that are not frames. Each counter is compared with the counter of the message's previous frame on the same channel.
    With --set bus.key=FILE the MAC and freshness of secured messages are checked before the end-to-end check.
    Diagnostic frames are recognised by the identifiers in the settings. All other messages are shown as bytes; use
    `cantools decode` for these messages.
    """
    from can_bridge.logs.log_reader import CanLog
    from can_bridge.tools.traffic import Summary

    uses = ("bus.nominal_bitrate", "bus.data_bitrate", "bus.e2e", "bus.key", DIAGNOSIS)
    config = settings("can decode", given, uses=uses).config.bus
    log = CanLog(file, channels=() if channel is None else (channel,))
    check_json(json_file, file, csv_file)
    if csv_file is not None:
        if os.path.realpath(csv_file) == os.path.realpath(file):
            raise BusError(f"{csv_file} is the file to read; give another name")
        check_output(csv_file, overwrite=None)
    found = Summary(config=config, key=key_of(config.key))
    with _csv_rows(csv_file) as write_rows, progress("frames") as report:
        for number, message in enumerate(log, 1):
            traffic = found.add(message)
            if summary:
                # Without a printed line for each frame, only the progress shows that the work continues.
                report(f"reading {file.name}", number)
            if traffic is None:
                continue
            write_rows(traffic)
            if not summary:
                console.print(_line(traffic, first=next(iter(log.channels))))
        if found.first_s is None:
            raise BusError(f"{file}: contains no CAN frame")
    used = {name: value for name, value in asdict(config).items() if name in ("nominal_bitrate", "data_bitrate", "e2e")}
    figures = {**found.figures(), "events": dict(log.events)}
    save_json(json_file, figures=figures, facts={"log": file.name, "config": used}, packages=("python-can",))
    _print_summary(found, log)
    for path in filter(None, (csv_file, json_file)):
        console.print(f"wrote {path}")


def _line(traffic: "Traffic", first: str) -> str:
    """Describe the newest frame. The frame's channel is stated if it is not `first`, the first channel of the log."""
    from can_bridge.bus.conversion import id_text

    frame, decoded = traffic.latest, traffic.decoded
    head = f"({traffic.last_ns / 1e9:.6f}) {id_text(frame)}"
    if decoded is None or not decoded.signals:
        what = traffic.name or "unknown" if decoded is None else f"{decoded.spec.name}, not readable"
        body = f"{what}: {frame.data.hex(' ') or 'empty'}"
    else:
        named = (f"{one.name}={one.shown}{f' {one.unit}' if one.unit else ''}" for one in decoded.signals)
        body = f"{decoded.spec.name}: {', '.join(named)}"
    verdicts = [] if traffic.check is None else [f"E2E {traffic.verdict}"]
    verdicts += [] if traffic.mac is None else [f"MAC {traffic.mac.value}"]
    where = f"  on {traffic.channel}" if traffic.channel != first else ""
    return f"{head} {body}" + (f"  [{', '.join(verdicts)}]" if verdicts else "") + where


@contextmanager
def _csv_rows(path: Path | None) -> "Iterator[Callable[[Traffic], None]]":
    """Yield a function that writes a frame's signals as rows of a CSV file. The file is created only if the `with`
    block ends without an error."""
    if path is None:
        yield lambda traffic: None
        return
    from can_bridge.bus.conversion import id_text
    from can_bridge.tools.traffic import CHECK_TEXT

    with replacing(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(("time_s", "id", "message", "e2e", "mac", "signal", "value", "unit", "text", "channel"))

        def write(traffic: "Traffic") -> None:
            frame, mac = traffic.latest, "" if traffic.mac is None else traffic.mac.value
            e2e = "" if traffic.check is None else CHECK_TEXT[traffic.check]
            head = (f"{traffic.last_ns / 1e9:.6f}", id_text(frame), traffic.name, e2e, mac)
            signals = () if traffic.decoded is None else traffic.decoded.signals
            rows = signals or [("", "", "", frame.data.hex())]
            writer.writerows((*head, *one, traffic.channel) for one in rows)

        yield write


def _print_summary(found: "Summary", log: "CanLog") -> None:
    from can_bridge.bus.conversion import id_text

    # Times are counted from the first frame, so that the numbers are short and all columns fit into 80 characters.
    begin_ns = round((found.first_s or 0.0) * 1e9)
    several = len(found.busy_ns) > 1
    numbers = (Column(name, justify="right") for name in ("frames", "rate, 1/s", "first, s", "last, s", "lost"))
    words = ("channel", "id", "message") if several else ("id", "message")
    table = Table(*words, *numbers, "checks", box=SIMPLE_HEAD, padding=0)
    for _, one in sorted(found.messages.items()):
        table.add_row(
            *((one.channel,) if several else ()),
            id_text(one.latest),
            one.name or "unknown",
            str(one.count),
            f"{one.mean_rate_hz:.2f}",
            f"{(one.first_ns - begin_ns) / 1e9:.6f}",
            f"{(one.last_ns - begin_ns) / 1e9:.6f}",
            str(one.lost) if one.is_protected else "-",
            ", ".join(f"{text} {count}" for text, count in one.verdicts.items()) or "-",
        )
    console.print(table)
    if found.unchecked_macs:
        console.print(f"{found.unchecked_macs} secured frames, MAC not checked: name the key with --set bus.key=FILE")
    loads = ", ".join(f"{f'{name} ' if several else ''}{100 * load:.2f} %" for name, load in found.loads.items())
    console.print(
        f"{found.frames} data frames, {found.remote} remote, {found.errors.total()} error frames"
        + (f" ({listed(found.errors)})" if found.errors else "")
        + (f", {found.unsound} that no bus can carry" if found.unsound else "")
        + f" in {found.span_s:.6f} s from {begin_ns / 1e9:.6f}; bus load by data frames {loads or '-'}"
    )
    if log.events:
        console.print(f"lines that are not frames: {listed(log.events)}")
