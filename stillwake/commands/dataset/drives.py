"""Recorded drives among the files of `stillwake dataset import`: logs of the bus, with forces from elsewhere."""

import hashlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from contract.config.loading import Loaded
from contract.errors import DatasetError
from contract.recording.facts import PlantFacts
from contract.sensor_layout import SensorLayout

if TYPE_CHECKING:
    import can

    from can_bridge.drives.log_frames import Verify
    from can_bridge.drives.log_periods import Scales
    from can_bridge.drives.log_to_series import LogReport, LogSeries
    from contract.recording.episode import Role
    from contract.recording.facts import ForcesClock
    from contract.recording.importing.assemble import Source
    from contract.recording.importing.forces import TimeSeries
    from contract.recording.importing.units import Reference

USES: Final = ("operating_point", "bus.frames", "bus.key")
"""Settings by which a log is read."""
_COUNTED: Final = 10_000
"""Frames between two reports of progress."""


@dataclass(frozen=True, kw_only=True)
class DriveOptions:
    """The options of the command line for logs.

    Attributes:
        fill, split: see `can_bridge.drives.log_to_series.series_of`.
        forces: FILE for every log, or LOG=FILE for one.
        names: of t, Cd and Cl in the forces' files.
        references: by Cd and Cl, what 1 is in those files.
        clock: of the forces' times; None where the file has it.
        shift_s: seconds to add to the forces' times.
    """

    fill: int
    split: bool
    forces: Sequence[str]
    names: Mapping[str, str]
    references: "Mapping[str, Reference]"
    clock: "ForcesClock | None"
    shift_s: float

    @property
    def given(self) -> bool:
        """Whether any of them was."""
        return bool(self.split or self.forces or self.names or self.clock or self.shift_s)


def is_log(path: Path) -> bool:
    """Whether this is a log of the bus, by its name."""
    from can_bridge.logs.log_reader import SUFFIXES

    return path.suffix.lower() in SUFFIXES


def forces_of(logs: Sequence[Path], forces: Sequence[str]) -> dict[Path, Path]:
    """The file of forces of every log. Raises DatasetError if a log has none or two, or a name before = is no log's."""
    found: dict[Path, Path] = {}
    general: list[Path] = []
    for text in forces:
        log, file = _pair(text, logs)
        if log is None:
            general.append(file)
        elif log in found:
            raise DatasetError(f"--forces {text}: {log} has forces already")
        else:
            found[log] = file
    if len(general) > 1:
        names = ", ".join(str(path) for path in logs)
        raise DatasetError(
            f"--forces {general[1]}: is the second one; with more than one write LOG=FILE, where LOG is one of {names}"
        )
    for log in logs:
        if log not in found and not general:
            raise DatasetError(
                f"{log}: a log has no drag and lift, and training needs them: give them with --forces, as a table "
                f"with t, Cd and Cl"
            )
    return {log: found.get(log) or general[0] for log in logs}


def _pair(text: str, logs: Sequence[Path]) -> tuple[Path | None, Path]:
    """LOG and FILE of LOG=FILE; without a log if none is named."""
    names = [log.name for log in logs]
    for log in logs:
        # Runs all call theirs frames.log: then the whole path identifies one.
        for name in (str(log), *([log.name] if names.count(log.name) == 1 else [])):
            if text.startswith(f"{name}="):
                return log, Path(text[len(name) + 1 :])
    return None, Path(text)


def names_of(logs: Sequence[Path]) -> dict[Path, str]:
    """What the episodes of each log are called: as its file, with the folder in front where two files share a name."""
    stems = [log.stem for log in logs]
    return {log: log.stem if stems.count(log.stem) == 1 else f"{log.resolve().parent.name} {log.stem}" for log in logs}


@dataclass(frozen=True, kw_only=True)
class Drive:
    """One log, made into sources for `contract.recording.importing.assemble`."""

    path: Path
    sources: "tuple[Source, ...]"
    report: "LogReport"


def read_drive(
    path: Path,
    name: str,
    role: "Role",
    forces: Path,
    layout: SensorLayout,
    scales: "Scales",
    options: DriveOptions,
    loaded: Loaded,
    progress: Callable[[str], None],
) -> Drive:
    """Read a log and its forces. Raises DatasetError, BusError, KeyFileError for what does not fit, by the file's name.
    `progress` is called with what is being read, and how many frames of it so far."""
    from can_bridge.drives.log_to_series import series_of
    from can_bridge.logs.log_reader import read_messages
    from can_bridge.wire.message_sets import message_set
    from can_bridge.wire.messages import SENSORS
    from contract.recording.findings import STEP_TOLERANCE
    from contract.recording.importing.assemble import Made, Source

    if len(layout) != SENSORS:
        raise DatasetError(
            f"{path}: a Pressure message has {SENSORS} sensors, --sensors names {len(layout)}: name those of the "
            f"message, in its order"
        )
    series = series_of(
        path,
        _counted(path, read_messages(path), progress),
        scales,
        fill=options.fill,
        split=options.split,
        sensors=layout.names,
        only=message_set(loaded.config.bus) if loaded.given & {"bus.frames", "bus.key"} else None,
        verify=_verifier(loaded),
    )
    forces_found = _forces(forces, series, scales, options, loaded.config.operating_point.convective_time)
    # As a table of one's own with times has it; and a gap of `fill` rows, with as much room for jitter.
    slack_s = STEP_TOLERANCE * series.period_s
    longest_s = (options.fill + 1.5) * series.period_s
    period = scales.period_s / loaded.config.operating_point.convective_time
    digest, forces_digest = _sha256(path), _sha256(forces)
    sources = []
    for number, piece in enumerate(series.pieces, 1):
        values = {
            name: one.at(piece.time_s, longest_gap=longest_s, slack=slack_s) for name, one in forces_found.items()
        }
        made = Made(
            name=name if len(series.pieces) == 1 else f"{name} {number}",
            series={
                "t": period * (piece.first_row + np.arange(len(piece), dtype=np.float64)),
                "action": piece.action,
                "Cp": piece.Cp,
                **values,
            },
            initial_action=piece.initial_action,
            provenance={
                "source_sha256": digest,
                "messages": series.report.messages,
                "first_pressure_s": series.start_s,
                "drift": series.report.drift,
                "filled": list(series.report.filled),
                "forces": forces.name,
                "forces_sha256": forces_digest,
            },
        )
        sources.append(Source(path=path, role=role, made=made))
    return Drive(path=path, sources=tuple(sources), report=series.report)


def scales_of(facts: PlantFacts, loaded: Loaded) -> "Scales":
    """Units of the wire by the operating point."""
    from can_bridge.drives.log_periods import Scales

    point = loaded.config.operating_point
    assert facts.control_period is not None
    assert facts.action_limit is not None
    return Scales(
        period_s=point.period_ns(facts.control_period) * 1e-9,
        dynamic_pressure=point.dynamic_pressure,
        flow_rate=point.flow_rate_scale,
        action_limit=facts.action_limit,
    )


def notes_on(drive: Drive) -> list[str]:
    """What a user should know of a log that was read, line by line."""
    report = drive.report
    pressures, commands = report.frames
    lines = [
        f"{drive.path}: {report.messages}, {pressures} pressures and {commands} commands; "
        f"clock {report.drift * 1e6:+.0f} ppm, jitter up to {report.jitter_s * 1e3:.2f} ms"
    ]
    if report.unused:
        unused = ", ".join(f"{count} {reason}" for reason, count in report.unused.items())
        lines.append(f"{drive.path}: frames not used: {unused}")
    if any(report.lost) or report.stale or any(report.filled):
        stale = f", {report.stale} too old" if report.stale else ""
        lines.append(
            f"{drive.path}: {report.lost[0]} pressures and {report.lost[1]} commands missing{stale}; filled on "
            f"straight lines: pressures in {report.filled[0]} rows, the action in {report.filled[1]}"
        )
    if report.checked is False:
        lines.append(f"{drive.path}: its authentication codes were not checked: give the key with --set bus.key=FILE")
    return lines + list(report.gaps)


def _verifier(loaded: Loaded) -> "Verify | None":
    from can_bridge.secoc.key import read_key
    from can_bridge.secoc.securing import verify

    if not loaded.config.bus.key:
        return None
    key = read_key(Path(loaded.config.bus.key))
    return lambda spec, data: verify(data, spec, key)


def _forces(
    path: Path, series: "LogSeries", scales: "Scales", options: DriveOptions, convective_time: float
) -> "dict[str, TimeSeries]":
    """Cd and Cl with times on the log's clock."""
    from contract.recording.importing.forces import read_forces

    # The sender's own seconds, seen on the log's clock, are as much longer as its periods are.
    pace = series.period_s / scales.period_s
    table = read_forces(path, options.names, options.references)
    clock = options.clock or table.clock
    if clock is None:
        raise DatasetError(
            f"{path}: give with --forces-clock what its times are: log (s on the log's clock), start (s since the "
            f"log's first pressure) or t_c (W / U_inf since then)"
        )
    scale = {"log": 1.0, "start": 1.0, "t_c": convective_time * pace}[clock]
    origin = (0.0 if clock == "log" else series.start_s) + options.shift_s
    return {name: one.shifted(scale=scale, origin=origin) for name, one in table.forces.items()}


def _counted(path: Path, messages: "Iterable[can.Message]", progress: Callable[[str], None]) -> "Iterator[can.Message]":
    """The same messages; an hour's log is half a million and takes some ten seconds."""
    progress(f"{path}")
    for number, message in enumerate(messages, 1):
        yield message
        if number % _COUNTED == 0:
            progress(f"{path}: {number} frames")


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
