"""The series of a run as CSV for other programs: one row per control period, with units in the header."""

import csv
from pathlib import Path
from typing import Final

from can_bridge.wire.messages import Mode, Reason
from contract.atomic import replacing
from contract.ledger import LEDGER_FIELDS
from firmware_sim.runs.run_log import WALL, RunLog

COLUMN_UNITS: Final = {
    "t": "t_c",
    **dict.fromkeys(LEDGER_FIELDS, "1"),
    "Uy_probe": "U_inf",
    "action": "U_inf W",
    "base_Cp": "1",
    "command": "U_inf W",
    "predicted_Cd": "1",
    "predicted_Cl": "1",
    "mode": "name",
    "reason": "name",
    "step_ms": "ms",
    "age_ms": "ms",
    "set_aside": "1",
    "speed": "m/s",
}
"""Unit of every column, in the order of `run_log.COLUMNS`; "name" for modes and reasons, which are written as names."""


def write_csv(path: Path, log: RunLog) -> None:
    """Write the series, completely or not at all; a missing value is empty. Raises StillwakeError on failure."""
    columns = {}
    for name, unit in COLUMN_UNITS.items():
        columns[f"{name} [{unit}]"] = [_text(name, value) for value in log.series[name]]
    if WALL in log.series:
        for name, Cp in zip(log.metadata.sensors, log.series[WALL].T, strict=True):
            columns[f"Cp_{name} [1]"] = [_text("Cp", value) for value in Cp]
    with replacing(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows([columns, *zip(*columns.values(), strict=True)])


def _text(name: str, value: float) -> str:
    if name == "mode":
        return Mode(int(value)).name
    if name == "reason":
        return Reason(int(value)).name
    return "" if value != value else f"{value:.10g}"
