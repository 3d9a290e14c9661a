"""A closed-loop run: its log with one row per control period, the traffic on its bus, and the files of its folder."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import numpy as np

from can_bridge.bus.interface import BusHealth
from can_bridge.bus.simulated.medium import BusActivity, Transmission
from can_bridge.wire.message_sets import MessageSet
from can_bridge.wire.messages import Mode, Reason
from contract import sensors
from contract.arrays import Array
from contract.atomic import check_writable, names_in, replacing
from contract.errors import ConfigError, StillwakeError
from contract.ledger import LEDGER_FIELDS
from contract.npz import read_npz
from contract.release import strict_json
from contract.sensor_layout import SensorLayout
from contract.typed import typed
from firmware_sim.runs.metadata import RunMetadata
from wake.plant.sample import Sample

_SCHEMA: Final = "stillwake-run/3"
WALL: Final = "wall_Cp"
"""Name of the series of Cp at the bundle's S sensors, shape (n, S) for n periods."""
WITHOUT: Final = ("without_Cd", "without_Cd_net", "without_Cl")
"""Names of the series of the same drive with the jets shut, for comparison; shape (n,) for n periods."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Row:
    """The values of one control period. `sample` and `speed` (of the vehicle, m/s) are from the period's start.
    `command` is the action in U_inf W that the ECU sent for this sample, `step_ms` the wall-clock time of its step on
    this machine; NaN if it skipped the step. The predictions are the controller's forecast for the next sample; NaN
    without a plan. `mode` and `reason` are the ECU's `Mode` and `Reason` (`can_bridge.wire.messages`) after its latest
    step. `age_ms` is the virtual time from the sampling of pressures to the arrival of the command computed from them;
    NaN if no command arrived in this period. Bit i of `set_aside` is 1 if the ECU has excluded the sensor i."""

    sample: Sample
    command: float
    predicted_Cd: float
    predicted_Cl: float
    mode: int
    reason: int
    step_ms: float
    age_ms: float
    set_aside: int = 0
    speed: float = np.nan

    def columns(self, layout: SensorLayout = sensors.TRUCK) -> dict[str, float]:
        """Return the row's numbers by the names in `COLUMNS`; the base Cp is the mean over the plant's base sensors."""
        base_Cp = float(np.mean(self.sample.Cp[layout.base]))
        sampled = {name: getattr(self.sample, name) for name in _SAMPLED}
        return {**sampled, "base_Cp": base_Cp, **{name: getattr(self, name) for name in _EXCHANGED}}


_SAMPLED: Final = ("t", *LEDGER_FIELDS, "Uy_probe", "action")
_EXCHANGED: Final = tuple(item.name for item in fields(Row) if item.name != "sample")
COLUMNS: Final = (*_SAMPLED, "base_Cp", *_EXCHANGED)
"""Names of the series of a run, which have one value per row."""


@dataclass(frozen=True, kw_only=True)
class BusTotals:
    """The counts of pressure frames and jet commands (both together) in the whole run."""

    sent: int
    lost: int
    rejected: int


@dataclass(frozen=True, kw_only=True)
class NodeErrors:
    """The state of a node's CAN controller at the end of the run: the name of a `can_bridge.bus.interface.BusState`,
    error counters, and the numbers of bus-offs and of frames that the controller could not send."""

    state: str
    tx_errors: int
    rx_errors: int
    bus_off: int
    refused: int

    @classmethod
    def of(cls, health: BusHealth, refused: int) -> "NodeErrors":
        return cls(**{**asdict(health), "state": health.state.name}, refused=refused)


@dataclass(frozen=True, kw_only=True)
class BusTraffic:
    """The traffic on the bus, including other nodes' frames. `load` is the share of the time in which the bus was not
    free, 0 to 1. `error_frames` counts the attempts to send that an error destroyed, or that no node acknowledged.
    `longest_wait_ms` is the longest time from queueing to the start of the successful transmission, by message name."""

    load: float
    frames: int
    error_frames: int
    longest_wait_ms: Mapping[str, float]
    nodes: Mapping[str, NodeErrors]


@dataclass(kw_only=True)
class WaitingTimes:
    """An observer of the simulated bus that records the longest time for which a frame of each message waited."""

    messages: MessageSet
    _longest_ns: dict[int, int] = field(default_factory=dict)

    def __call__(self, seen: Transmission) -> None:
        if seen.frame.is_extended:
            return
        frame_id, waited_ns = seen.frame.frame_id, seen.begin_ns - seen.queued_ns
        self._longest_ns[frame_id] = max(waited_ns, self._longest_ns.get(frame_id, 0))

    def traffic(self, activity: BusActivity, nodes: Mapping[str, NodeErrors]) -> BusTraffic:
        sent = (spec for spec in self.messages.specs if spec.frame_id in self._longest_ns)
        longest = {spec.name: self._longest_ns[spec.frame_id] / 1e6 for spec in sent}
        counts = {name: getattr(activity, name) for name in ("load", "frames", "error_frames")}
        return BusTraffic(**counts, longest_wait_ms=longest, nodes=dict(nodes))


@dataclass(frozen=True, kw_only=True, eq=False)
class RunLog:
    """A finished run of n periods. `series` has arrays by name: those in `COLUMNS`, shape (n,), `WALL` if the sensors
    were recorded, `WITHOUT` for a drive. `enabled_at` is the first row in which control is requested; n if none is."""

    series: Mapping[str, Array]
    enabled_at: int
    bus: BusTotals
    metadata: RunMetadata
    traffic: BusTraffic

    @classmethod
    def of(
        cls,
        rows: list[Row],
        enabled_at: int,
        bus: BusTotals,
        metadata: RunMetadata,
        layout: SensorLayout = sensors.TRUCK,
        *,
        traffic: BusTraffic,
        without: Mapping[str, Array] | None = None,
    ) -> "RunLog":
        """Create the log from its rows; `without` has the series named in `WITHOUT`."""
        columns = [row.columns(layout) for row in rows]
        series = {name: np.array([item[name] for item in columns], dtype=float) for name in COLUMNS}
        series |= without or {}
        mounted = layout.indices(metadata.sensors)
        series[WALL] = np.array([row.sample.Cp[mounted] for row in rows], dtype=float)
        return cls(series=series, enabled_at=enabled_at, bus=bus, metadata=metadata, traffic=traffic)


def save(path: Path, log: RunLog) -> None:
    """Write the log as .npz, completely or not at all."""
    header: dict[str, Any] = {"schema": _SCHEMA, "enabled_at": log.enabled_at, "bus": asdict(log.bus)}
    header |= {"traffic": asdict(log.traffic), "metadata": log.metadata.to_tree()}
    arrays: dict[str, Any] = dict(log.series)
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, header=json.dumps(header), **arrays)


def load(path: Path) -> RunLog:
    """Read a file written by `save`. Raises StillwakeError if the file is missing, damaged or of another schema."""
    try:
        data = read_npz(path)
        header = strict_json.decode(data.text("header").encode())
        if (schema := header.get("schema")) != _SCHEMA:
            made_by = header.get("metadata", {}).get("versions", {}).get("stillwake", "an unknown version")
            reads = f"stillwake {version('stillwake')} only reads {_SCHEMA!r}: make the run again"
            raise ValueError(f"it has the schema {schema!r}, made by stillwake {made_by}; {reads}")
        count, metadata = len(data["t"]), RunMetadata.from_tree(header["metadata"])
        # These two columns do not exist in runs of version 0.9.0.
        series = {"set_aside": np.zeros(count), "speed": np.full(count, np.nan)}
        for name in (*COLUMNS, *WITHOUT):
            if name in data or name not in (*series, *WITHOUT):
                series[name] = data.numbers(name, count)
        if WALL in data:
            series[WALL] = data.numbers(WALL, count, len(metadata.sensors))
        enabled_at, bus = typed(header["enabled_at"], int), typed(header["bus"], BusTotals)
        traffic = typed(header["traffic"], BusTraffic)
        log = RunLog(series=series, enabled_at=enabled_at, bus=bus, metadata=metadata, traffic=traffic)
        _check(log)
        return log
    except FileNotFoundError as error:
        raise StillwakeError(f"{path}: not the series of a run (there is no such file)") from error
    except (OSError, KeyError, ValueError, TypeError, AttributeError, ConfigError) as error:
        raise StillwakeError(f"{path}: not the series of a run ({error})") from error


def _check(log: RunLog) -> None:
    t = log.series["t"]
    for name in ("t", "Cd", "Cl", "action"):
        if not np.isfinite(log.series[name]).all():
            raise ValueError(f"{name!r} must hold finite numbers")
    if not len(t) or (np.diff(t) <= 0.0).any():
        raise ValueError("'t' must increase")
    if not 0 <= log.enabled_at <= len(t):
        raise ValueError(f"enabled_at = {log.enabled_at}: must be a row from 0 to {len(t)}")
    for name, kind in (("mode", Mode), ("reason", Reason)):
        if not set(log.series[name].tolist()) <= {float(one) for one in kind}:
            raise ValueError(f"{name!r} must hold values of {kind.__name__}")


class RunFolder:
    """The files that `stillwake run` writes: the series of `RunLog`, `summary.whole_summary` as JSON, every frame on
    the bus in the format of candump, the vorticity at the end of the lead-in and of the run as pictures, and the wake
    as `wake_stills.WakeStills`, which is missing in folders of earlier versions."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.series, self.wake = path / "series.npz", path / "wake.npz"
        self.frames, self.summary, self.report = path / "frames.log", path / "summary.json", path / "report.html"
        self.uncontrolled_picture = path / "vorticity_uncontrolled.png"
        self.controlled_picture = path / "vorticity_controlled.png"

    def check_free(self, *, overwrite: bool) -> None:
        """Check the folder. Raises StillwakeError if it cannot be written, contains files but no run, or contains a run
        and `overwrite` is False. A folder that contains only the developed state of an OpenFOAM case is accepted."""
        check_writable(self.path, folder=True)
        there = names_in(self.path) if self.path.is_dir() else set()
        holds_a_run = {self.series.name, self.summary.name} & there
        if there - {"openfoam"} and not holds_a_run:
            raise StillwakeError(f"{self.path}: holds files that no run wrote; give another folder")
        if not overwrite and holds_a_run:
            raise StillwakeError(f"{self.path} holds a run: give another folder, or --overwrite to replace it")
