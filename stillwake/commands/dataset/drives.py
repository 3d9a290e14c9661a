"""The part of `stillwake dataset import` that reads recorded drives: logs of the bus, and forces from other files."""

import hashlib
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import timedelta, timezone, tzinfo
from pathlib import Path
from typing import TYPE_CHECKING, Final
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

import numpy as np

from contract.config.loading import Loaded
from contract.errors import ConfigError, DatasetError
from contract.recording.episode import PlantFacts
from contract.sensor_layout import SensorLayout
from stillwake.console.terminal import listed

if TYPE_CHECKING:
    import can

    from can_bridge.drives.log_periods import Scales
    from can_bridge.drives.log_to_series import LogSeries
    from can_bridge.logs.log_reader import CanLog
    from contract.recording.episode import ForcesClock, Role
    from contract.recording.importing.assemble import EpisodeSource
    from contract.recording.importing.forces import ForcesTable
    from contract.recording.importing.source_file import Reference

USES: Final = ("operating_point", "bus.frames", "bus.key", "ecu.speed.oldest_ms", "ecu.speed.most_acceleration")
"""Settings that are used to read a log of the bus."""
FORCES_NAMES: Final = ("t", "Cd", "Cl")
"""Columns of a table of forces."""


def zone_of(text: str) -> tzinfo | None:
    """Return the time zone with a name such as Europe/Berlin, or with an offset such as +02:00; None if the text is
    empty. Raises ConfigError for another text."""
    if not text:
        return None
    try:
        if offset := re.fullmatch(r"([+-])(\d\d):?(\d\d)", text):
            minutes = 60 * int(offset[2]) + int(offset[3])
            return timezone(timedelta(minutes=-minutes if offset[1] == "-" else minutes))
        return ZoneInfo(text)
    except (ValueError, OSError, ZoneInfoNotFoundError):
        raise ConfigError(
            f"--log-zone {text}: must be a name such as Europe/Berlin or UTC, or an offset such as +02:00"
        ) from None


def forces_of(logs: Sequence[Path], forces: Sequence[str]) -> dict[Path, Path]:
    """Return each log with its file of forces. Raises DatasetError if a log is given twice or has no file or two files,
    or if two files are given without the name of a log."""
    found: dict[Path, Path] = {}
    general: list[Path] = []
    for path in logs:
        if logs.count(path) > 1:
            raise DatasetError(f"{path}: given twice, but an episode has one role: give two logs, or split this log")
    # Every run folder has a log named frames.log. If two logs share a name, only the whole path identifies a log.
    names = [log.name for log in logs]
    labels = {str(log): log for log in logs} | {log.name: log for log in logs if names.count(log.name) == 1}
    for text in forces:
        label = next((one for one in labels if text.startswith(f"{one}=")), None)
        if label is None:
            general.append(Path(text))
        elif labels[label] in found:
            raise DatasetError(f"--forces {text}: {labels[label]} already has a file of forces")
        else:
            found[labels[label]] = Path(text[len(label) + 1 :])
    if wrong := [text for text in map(str, general) if "=" in text and not Path(text).exists()]:
        raise DatasetError(f"--forces {wrong[0]}: no such file; LOG= must name one of {', '.join(map(str, logs))}")
    if len(general) > 1:
        raise DatasetError(
            f"--forces {general[1]} is a second file for all logs; write LOG=FILE, where LOG is one of "
            f"{', '.join(map(str, logs))}"
        )
    for log in logs:
        if log not in found and not general:
            raise DatasetError(
                f"{log}: a log has no drag and lift, which training needs: give them with --forces, as a table "
                f"with t, Cd and Cl"
            )
    return {log: found.get(log) or general[0] for log in logs}


def names_of(logs: Sequence[Path]) -> dict[Path, str]:
    """Return the name of each log's episodes: the file name, with the folder if two logs share the file name."""
    from can_bridge.logs.log_reader import stem_of

    stems = [stem_of(log) for log in logs]
    names = (
        stem if stems.count(stem) == 1 else f"{Path(os.path.realpath(log)).parent.name} {stem}"
        for log, stem in zip(logs, stems, strict=True)
    )
    return dict(zip(logs, names, strict=True))


@dataclass(frozen=True, kw_only=True)
class DriveReader:
    """A reader of logs and their forces, with the options of the command line.

    Attributes:
        fill, split: see `can_bridge.drives.log_to_series.series_of`.
        names: column names for t, Cd and Cl in the files of forces, if a column has another name.
        references: numbers that mean Cd = 1 and Cl = 1 in the files of forces, by the names Cd and Cl.
        clock: clock of the times in the files of forces; None if each file states its clock.
        shift_s: time in s to add to the times of the forces.
        channels: channels to read from the logs; if empty, a log's channel is found from its frames.
        zone: time zone of logs whose times begin in local time; None if the user gave no zone.
        forces: the file of forces of each log.
    """

    fill: int
    split: bool
    names: Mapping[str, str]
    references: "Mapping[str, Reference]"
    clock: "ForcesClock | None"
    shift_s: float
    channels: Sequence[str]
    zone: tzinfo | None
    loaded: Loaded
    facts: PlantFacts
    layout: SensorLayout
    forces: Mapping[Path, Path]

    def read(
        self, path: Path, name: str, role: "Role", progress: Callable[[str], None]
    ) -> "tuple[list[EpisodeSource], LogSeries, CanLog]":
        """Read a log and its forces. Raises DatasetError, BusError or KeyFileError, with the file's name, for invalid
        content. `progress` is called with a text that states the file and the number of frames read so far."""
        from can_bridge.drives.log_periods import Scales
        from can_bridge.drives.log_to_series import series_of
        from can_bridge.logs.log_reader import CanLog
        from can_bridge.secoc.key import read_key
        from can_bridge.wire.message_sets import message_set
        from can_bridge.wire.messages import SENSORS

        if len(self.layout) != SENSORS:
            raise DatasetError(
                f"{path}: a Pressure message has {SENSORS} sensors, but --layout has {len(self.layout)}: list the "
                f"sensors in the order of the message"
            )
        config, given = self.loaded.config, self.loaded.given
        assert self.facts.control_period is not None and self.facts.action_limit is not None
        scales = Scales(
            period=self.facts.control_period,
            point=config.operating_point,
            action_limit=self.facts.action_limit,
            given=given,
            believed=config.ecu.speed,
        )
        log = CanLog(path, zone=self.zone, channels=self.channels)
        series = series_of(
            path,
            _counted(log, progress),
            scales,
            fill=self.fill,
            split=self.split,
            sensors=self.layout.names,
            only=message_set(config.bus) if given & {"bus.frames", "bus.key"} else None,
            key=read_key(Path(config.bus.key)) if config.bus.key else None,
        )
        _check_limit(path, series, scales)
        forces = self._forces(self.forces[path], series, log)
        return self._sources(path, name, role, forces, series, scales.period), series, log

    def _sources(
        self, path: Path, name: str, role: "Role", forces: "ForcesTable", series: "LogSeries", period: float
    ) -> "list[EpisodeSource]":
        """Return an episode's source for each piece of the log, with the forces at the times of its rows."""
        from contract.recording.importing.assemble import EpisodeSource
        from contract.recording.importing.source_file import Contents
        from contract.recording.importing.stored import INITIAL_ACTION

        provenance = {
            "messages": series.messages,
            "channel": series.channel,
            "speed": None if series.speed is None else [float(one) for one in series.speed],
            "first_pressure_s": series.start_s,
            "drift": series.drift,
            "filled": list(series.filled),
            "forces": forces.path.name,
            "forces_sha256": hashlib.sha256(forces.path.read_bytes()).hexdigest(),
        }
        sources = []
        for number, piece in enumerate(series.pieces, 1):
            arrays = {
                "t": period * (piece.first_row + np.arange(len(piece), dtype=np.float64)),
                "action": piece.action,
                "Cp": piece.Cp,
                INITIAL_ACTION: np.array([piece.initial_action]),
                **forces.at(piece.time_s, **self._room(series)),
            }
            named = name if len(series.pieces) == 1 else f"{name} {number}"
            made = Contents(arrays=arrays, files=(path,))
            sources.append(EpisodeSource(path=path, role=role, named=named, made=made, provenance=provenance))
        return sources

    def _forces(self, path: Path, series: "LogSeries", log: "CanLog") -> "ForcesTable":
        """Return the forces with their times converted to the log's clock."""
        from contract.recording.importing.forces import read_forces

        table = read_forces(path, self.names, self.references)
        clock = self.clock or table.clock
        if clock is None:
            raise DatasetError(
                f"{path}: state with --forces-clock how its times count: log (s on the log's clock), start (s since "
                f"the log's first pressure) or t_c (W / U_inf since that pressure)"
            )
        if clock == "t_c":
            return replace(table, t=series.travel.time(table.t) + self.shift_s)
        table = replace(table, t=table.t + ((0.0 if clock == "log" else series.start_s) + self.shift_s))
        if clock == "log" and log.is_local and self.zone is None:
            self._check_zone(log.path, series, table)
        return table

    def _check_zone(self, log: Path, series: "LogSeries", forces: "ForcesTable") -> None:
        """Raise DatasetError if the zone of a log in local time is uncertain: the log lies within the times of the
        forces in at least one zone other than UTC."""
        zones = []
        for minutes in range(-12 * 60, 14 * 60 + 1, 15):
            with suppress(DatasetError):
                for piece in series.pieces:
                    forces.at(piece.time_s - 60.0 * minutes, **self._room(series))
                zones.append(minutes)
        if zones and zones != [0]:
            texts = [f"{'-' if one < 0 else '+'}{abs(one) // 60:02d}:{abs(one) % 60:02d}" for one in zones]
            shown = f"{texts[0]} to {texts[-1]}" if len(texts) > 3 else " and ".join(texts)
            raise DatasetError(
                f"{log} begins in local time of an unknown zone; the times of the forces fit the zones {shown}: "
                f"name the right zone with --log-zone"
            )

    def _room(self, series: "LogSeries") -> dict[str, float]:
        """Return the tolerances in s for `ForcesTable.at`: the largest distance between a time in the table and the
        time of a row, and the longest gap, which is `fill` missing rows plus an allowance for jitter."""
        from contract.recording.findings import STEP_TOLERANCE

        return {"slack": STEP_TOLERANCE * series.period_s, "longest_gap": (self.fill + 1.5) * series.period_s}


def notes_on(series: "LogSeries", log: "CanLog") -> list[str]:
    """Return notes on a log for the user, line by line."""
    pressures, commands = series.frames
    lines = [
        f"{series.messages}, {pressures} pressures and {commands} commands; "
        f"clock {series.drift * 1e6:+.0f} ppm, jitter up to {series.jitter_s * 1e3:.2f} ms",
        _speed_line(series),
    ]
    if len(log.channels) > 1:
        counts = ", ".join(f"{name} {count}" for name, count in sorted(log.channels.items()))
        lines.append(f"read from the channel {series.channel}; frames by channel: {counts}")
    if events := listed(log.events):
        lines.append(f"{log.messages} frames; lines of other kinds: {events}")
    if series.unused:
        lines.append(f"frames not used: {', '.join(f'{count} {reason}' for reason, count in series.unused.items())}")
    if any(series.lost) or series.stale or any(series.filled):
        stale = f", {series.stale} too old" if series.stale else ""
        lines.append(
            f"{series.lost[0]} pressures and {series.lost[1]} commands missing{stale}; filled by linear "
            f"interpolation: pressures in {series.filled[0]} rows, the action in {series.filled[1]}"
        )
    if series.checked is False:
        lines.append("its authentication codes were not checked: give the key with --set bus.key=FILE")
    return [f"{log.path}: {line}" for line in (*lines, *series.gaps)]


def _speed_line(series: "LogSeries") -> str:
    if series.speed is None:
        return "no vehicle speed in the log: Cp is computed with operating_point"
    slow, median, fast = series.speed
    without = f"; {series.without_speed} rows without a speed" if series.without_speed else ""
    between = "; rows interpolated at equal distances travelled" if series.is_resampled else ""
    span = f" ({slow:g} to {fast:g})" if slow < fast else ""
    return f"Cp is computed with the log's vehicle speed, {median:g} m/s{span}{without}{between}"


def _check_limit(path: Path, series: "LogSeries", scales: "Scales") -> None:
    """Raise DatasetError if actions exceed the limit only because the vehicle is slow. The largest flow rate of the
    jets is fixed: the limit times the design speed times W. An action is a flow rate divided by the present speed and
    by W, so at a lower speed the same flow rate is a larger action."""
    from contract.recording.findings import LIMIT_TOLERANCE

    largest = max(float(np.abs(piece.action).max()) for piece in series.pieces)
    slowest = scales.point.speed if series.speed is None else series.speed[0]
    if largest > scales.action_limit * (1.0 + LIMIT_TOLERANCE) >= largest * slowest / scales.point.speed:
        raise DatasetError(
            f"{path}: actions reach {largest:.4g} U_inf W, beyond the limit of {scales.action_limit:g}: at {slowest:g} "
            f"m/s the same jet flow is a larger action than at {scales.point.speed:g} m/s; give --set "
            f"flow.action_limit={np.ceil(largest * 1e4) / 1e4:g}"
        )


def _counted(log: "CanLog", progress: Callable[[str], None]) -> "Iterator[can.Message]":
    """Yield the messages and report how many were read, because reading an hour of a log takes ten seconds."""
    progress(f"{log.path}")
    for number, message in enumerate(log, 1):
        yield message
        if number % 10_000 == 0:
            progress(f"{log.path}: {number} frames")
