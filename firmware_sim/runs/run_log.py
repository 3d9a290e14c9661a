"""What a closed-loop run leaves behind: one row a control period, and the totals of the bus."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
import numpy.typing as npt

from contract.atomic import replacing
from contract.errors import StillwakeError

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Row:
    """One control period, sampled at its start.

    Attributes:
        t: in t_c.
        Cd, Cl, Cd_slot_pressure, Cd_slot_viscous, Cd_momentum, jet_power, Uy_probe: the plant's ledger
            (`wake.truck.sample.Sample`).
        base_Cp: mean over the base sensors.
        action: jet flow rate in force, U_inf W.
        command: sent by the ECU for this period's sample, U_inf W; NaN if it skipped the step.
        predicted_Cd, predicted_Cl: the controller's forecast for the next sample; NaN without one.
        mode: `can_bridge.wire.messages.Mode` of the ECU as of its latest step.
        step_ms: wall-clock time of the ECU's step on this machine; NaN if it skipped the step.
        age_ms: from the sampling of the pressures behind the command that the jets follow in this period to its
            arrival there, in virtual time; NaN if none came.
    """

    t: float
    Cd: float
    Cl: float
    Cd_slot_pressure: float
    Cd_slot_viscous: float
    Cd_momentum: float
    jet_power: float
    Uy_probe: float
    base_Cp: float
    action: float
    command: float
    predicted_Cd: float
    predicted_Cl: float
    mode: int
    step_ms: float
    age_ms: float


@dataclass(frozen=True, kw_only=True)
class BusTotals:
    """Pressure frames and jet commands of the whole run."""

    sent: int
    lost: int
    rejected: int


@dataclass(frozen=True, kw_only=True, eq=False)
class RunLog:
    """A finished run.

    Attributes:
        series: the columns of `Row`, (n,) each.
        enabled_at: index of the first row with control requested.
        bus: totals.
        facts: bundle, sensors, settings and versions, for the report.
    """

    series: Mapping[str, Array]
    enabled_at: int
    bus: BusTotals
    facts: Mapping[str, Any]

    @classmethod
    def of(cls, rows: list[Row], enabled_at: int, bus: BusTotals, facts: Mapping[str, Any]) -> "RunLog":
        series = {item.name: np.array([getattr(row, item.name) for row in rows], dtype=float) for item in fields(Row)}
        return cls(series=series, enabled_at=enabled_at, bus=bus, facts=facts)


def save(path: Path, log: RunLog) -> None:
    """Write as .npz, whole or not at all."""
    header = json.dumps({"enabled_at": log.enabled_at, "bus": asdict(log.bus), "facts": log.facts})
    arrays: dict[str, Any] = dict(log.series)
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, header=header, **arrays)


def load(path: Path) -> RunLog:
    """Read what `save` wrote.

    Raises:
        StillwakeError: if the file is missing or damaged.
    """
    try:
        with np.load(path) as data:
            header = json.loads(str(data["header"]))
            series = {item.name: data[item.name] for item in fields(Row)}
        return RunLog(
            series=series, enabled_at=header["enabled_at"], bus=BusTotals(**header["bus"]), facts=header["facts"]
        )
    except (OSError, KeyError, ValueError, TypeError, EOFError, BadZipFile) as error:
        raise StillwakeError(f"{path}: not the series of a run ({error})") from error
