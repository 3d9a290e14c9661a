"""The command that reports the load of the bus and the worst-case response times of its messages."""

from dataclasses import asdict
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import typer
from rich.box import SIMPLE_HEAD
from rich.table import Column, Table
from rich.text import Text

from contract.config.tree import Config
from stillwake.console import options as shared
from stillwake.console.outputs import check_json, save_json
from stillwake.console.settings import settings
from stillwake.console.terminal import console

if TYPE_CHECKING:
    from can_bridge.timing.bus_load import BusLoad, MessageLoad

_OURS: Final = ("bus.nominal_bitrate", "bus.data_bitrate", "bus.frames", "bus.key")
USES: Final = ("operating_point", "flow.control_period", "ecu.compute_time_ms", *_OURS, "bus.background")
_HEADS: Final = ("id", "message", "bytes", "period", "jitter", "frame", "blocking", "response", "deadline", "met")


def load(
    json_file: shared.JsonFile = None,
    given: shared.Settings = [],  # noqa: B006
) -> None:
    """Show the load of the bus, and the worst-case response time of every message on it.

    bus.frames and bus.key select stillwake's own messages; bus.background.* selects the messages of other nodes. The
    response time of an ECU's message is counted from the sampling of the pressures, without the ECU's compute time;
    instead, the deadline of the command is shortened by the compute time. Exit status 3: a message can miss its
    deadline.
    """
    from can_bridge.timing.bus_load import bus_load

    check_json(json_file)
    config = settings("can load", given, uses=USES).config
    found = bus_load(config)
    _print(found)
    packages = ("stillwake", "cantools") if config.bus.background.dbc else ("stillwake",)
    save_json(json_file, figures=figures(found), facts=facts(config), packages=packages)
    if found.late:
        raise typer.Exit(3)


def figures(found: "BusLoad") -> dict[str, Any]:
    """Return the figures for `--json`: loads as shares of the bus's time, times in ms, None where there is no bound."""
    return {
        "load_mean": found.mean,
        "load_worst": found.worst,
        "late": [one.message.name for one in found.late],
        "left_out": list(found.left_out),
        "messages": [_figures(one) for one in found.messages],
    }


def facts(config: Config) -> dict[str, Any]:
    """Return the settings on which the figures depend, and the hash of the other nodes' DBC file."""
    bus, dbc = config.bus, config.bus.background.dbc
    return {
        "frames": bus.frames,
        "authenticated": bool(bus.key),
        "nominal_bitrate": bus.nominal_bitrate,
        "data_bitrate": bus.data_bitrate,
        "control_period_ms": config.period_ns / 1e6,
        "compute_time_ms": config.ecu.compute_time_ms,
        "background": asdict(bus.background),
        "background_sha256": sha256(Path(dbc).read_bytes()).hexdigest() if dbc else None,
    }


def _figures(one: "MessageLoad") -> dict[str, Any]:
    message, response = one.message, one.response
    return {
        "name": message.name,
        "id": message.frame_id,
        "extended": message.is_extended,
        "fd": message.is_fd,
        "ours": one.ours,
        "bytes": message.length,
        "period_ms": message.period_ns / 1e6,
        "jitter_ms": message.jitter_ns / 1e6,
        "frame_mean_ms": one.mean_ns / 1e6,
        "frame_worst_ms": one.worst_ns / 1e6,
        "blocking_ms": response.blocking_ns / 1e6,
        "response_ms": None if response.response_ns is None else response.response_ns / 1e6,
        "deadline_ms": response.deadline_ns / 1e6,
        "in_time": response.in_time,
    }


def _table(found: "BusLoad") -> Table:
    # A table without lines and edges, with one space between columns, fits into a terminal of 80 columns.
    heads = (Column(head, justify="left" if head in ("message", "met") else "right") for head in _HEADS)
    title = "worst cases in ms; messages of stillwake in bold"
    table = Table(*heads, title=title, box=SIMPLE_HEAD, padding=0, show_edge=False)
    for one in found.messages:
        message, response = one.message, one.response
        late = not response.in_time
        table.add_row(
            f"{message.frame_id:08X}" if message.is_extended else f"{message.frame_id:03X}",
            message.name,
            str(message.length),
            f"{message.period_ns / 1e6:g}",
            f"{message.jitter_ns / 1e6:.3f}",
            f"{one.worst_ns / 1e6:.3f}",
            f"{response.blocking_ns / 1e6:.3f}",
            "no bound" if response.response_ns is None else f"{response.response_ns / 1e6:.3f}",
            f"{response.deadline_ns / 1e6:g}",
            Text("NO", style="bold red") if late else "yes",
            style="bold" if one.ours else None,
        )
    return table


def _print(found: "BusLoad") -> None:
    console.print(_table(found))
    console.print(f"load: {100 * found.mean:.1f} % with random contents, {100 * found.worst:.1f} % at worst")
    if found.left_out:
        console.print(f"left out: {', '.join(found.left_out)}")
    if found.late:
        names = [one.message.name for one in found.late]
        listed = ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")
        console.print(f"{len(names)} of {len(found.messages)} can be late: {listed}", style="bold red")
