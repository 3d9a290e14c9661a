"""The export of a run for other programs: the series as CSV, with units in the header, or a measurement file, which has
the frames with their signals, the series, the events, and pictures of the wake."""

import csv
import io
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from PIL import Image, ImageDraw

from can_bridge.logs.entries import ChannelGroup, NamedChannel
from can_bridge.logs.log_reader import CanLog
from can_bridge.logs.mcap_file import EVENTS_TOPIC, WAKE_TOPIC
from can_bridge.tools.measurement import WORDS, write_measurement
from can_bridge.wire.messages import Mode, Reason
from contract.arrays import Array
from contract.atomic import replacing
from contract.ledger import LEDGER_FIELDS
from firmware_sim.runs import run_log, wake_stills
from firmware_sim.runs.metadata import settings_of
from firmware_sim.runs.run_log import WALL, WITHOUT, RunFolder, RunLog
from firmware_sim.runs.run_page.run_data import events
from wake.pictures.drawing import FIELD_COLOURS, outline
from wake.pictures.fields import TOP

COLUMN_UNITS: Final = {
    "t": "t_c",
    **dict.fromkeys(LEDGER_FIELDS, "1"),
    "Uy_probe": "U_inf",
    "action": "U_inf W",
    "base_Cp": "1",
    "command": "U_inf W",
    **dict.fromkeys(("predicted_Cd", "predicted_Cl"), "1"),
    **dict.fromkeys(("mode", "reason"), "name"),
    **dict.fromkeys(("step_ms", "age_ms"), "ms"),
    "set_aside": "1",
    "speed": "m/s",
}
"""Unit of every column, in the order of `run_log.COLUMNS`; "name" for modes and reasons, which are written as names."""
_NO_UNIT: Final = {"1": "", "name": ""}
_BODY: Final = (209, 209, 209)


def write_csv(path: Path, log: RunLog) -> None:
    """Write the series, completely or not at all; a missing value is empty. Raises StillwakeError if this fails."""
    columns = {f"{name} [{unit}]": [_text(name, value) for value in values] for name, unit, values in _series(log)}
    with replacing(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows([columns, *zip(*columns.values(), strict=True)])


def _series(log: RunLog) -> Iterator[tuple[str, str, Array]]:
    """Yield name, unit and values, shape (n,), of each series over the n periods of a run."""
    for name, unit in (COLUMN_UNITS | {name: "1" for name in WITHOUT if name in log.series}).items():
        yield name, unit, log.series[name]
    if WALL in log.series:
        for name, Cp in zip(log.metadata.sensors, log.series[WALL].T, strict=True):
            yield f"Cp_{name}", "1", Cp


def _text(name: str, value: float) -> str:
    if name == "mode":
        return Mode(int(value)).name
    if name == "reason":
        return Reason(int(value)).name
    return "" if value != value else f"{value:.10g}"


def write_run(path: Path, folder: RunFolder) -> Counter[str]:
    """Write a finished run as a measurement file. Return, by message, how many frames have no channels in the file.
    Raises StillwakeError if there is no run, a file of the run is damaged, or the new file cannot be written."""
    log = run_log.load(folder.series)
    frames = CanLog(folder.frames) if folder.frames.is_file() else ()
    facts = settings_of(log.metadata) | dict(log.metadata.versions) | {"bundle": log.metadata.digest}
    return write_measurement(path, frames, more=[run_group(log)], events=_dated(folder, log), facts=facts)


def run_group(log: RunLog) -> ChannelGroup:
    """Return a run's series as channels. Their times are the starts of the periods, in s from the start of the run."""
    point = log.metadata.config.operating_point
    return ChannelGroup(
        name="Run",
        times_s=np.arange(len(log.series["t"])) * log.metadata.config.period_ns / 1e9,
        channels=tuple(
            NamedChannel(name, _NO_UNIT.get(unit, unit), values, WORDS.get(name.title(), {}))
            for name, unit, values in _series(log)
        ),
        comment=f"U_inf = {point.speed:g} m/s, W = {point.width:g} m, t_c = {point.convective_time:g} s",
    )


def _dated(folder: RunFolder, log: RunLog) -> Iterator[tuple[str, int, Any]]:
    """Yield events and pictures in the order of time, as messages in Foxglove's formats."""
    from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
    from foxglove_schemas_protobuf.Log_pb2 import Log

    period_ns = log.metadata.config.period_ns
    found = [
        (EVENTS_TOPIC, one.period * period_ns, Log(level=Log.INFO, message=one.text, name=one.kind))
        for one in events(log)
    ]
    if folder.wake.is_file():
        wake = wake_stills.load(folder.wake, log)
        x_min, x_max, y_min, y_max = wake.scene.view
        scale = np.array(wake.scene.size) / (x_max - x_min, y_max - y_min)
        body = [tuple(point) for point in (outline(log.metadata.config.body) * (1, -1) - (x_min, -y_max)) * scale]
        colours = np.round(255.0 * mpl.colormaps[FIELD_COLOURS](np.linspace(0.0, 1.0, 2 * TOP + 1))[:, :3])
        for index, k in enumerate(wake.k.tolist()):
            picture = Image.fromarray(colours.astype(np.uint8)[wake.levels(index).astype(int) + TOP])
            ImageDraw.Draw(picture).polygon(body, fill=_BODY)
            buffer = io.BytesIO()
            picture.save(buffer, format="JPEG", quality=90)  # Foxglove and Rerun both show JPEG
            shown = CompressedImage(frame_id="wake", format="jpeg", data=buffer.getvalue())
            found.append((WAKE_TOPIC, k * period_ns, shown))
    for topic, time_ns, message in sorted(found, key=lambda one: one[1]):
        message.timestamp.FromNanoseconds(time_ns)
        yield topic, time_ns, message
