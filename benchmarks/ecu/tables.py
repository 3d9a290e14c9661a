"""The tables of the ECU's sensor check."""

from pathlib import Path
from typing import Any

from benchmarks.common.markdown import read, table


def tables(results: Path) -> dict[str, str]:
    """Every table by its marker."""
    figures = read(results / "sensor_check.json")["figures"]
    return {
        "sensor_check_alarms": alarms(figures["false_alarms"]),
        "sensor_check_faults": faults(figures["faults"]),
    }


def alarms(rows: list[dict[str, Any]]) -> str:
    """False alarms by what disturbed the sound sensors, and by role."""
    words = {"none": "nothing", "noise 0.9": "noise of 90 %", "lost 0.3": "30 % of the frames lost"}
    found = [
        (
            words[row["through"]],
            row["role"],
            round(row["hours"], 3),
            row["alarms"],
            f"below {row['below_per_hour']:.3g}" if row["alarms"] == 0 else f"{row['per_hour']:.3g}",
        )
        for row in rows
    ]
    return table(("disturbed by", "episodes", "hours", "false alarms", "an hour"), found)


def faults(rows: list[dict[str, Any]]) -> str:
    """What is found of each fault."""
    found = [
        (
            row["fault"],
            row["sensor"],
            row["starts"],
            row["set_aside"],
            row["shut"],
            row["wrong"],
            row["unseen"],
            row["periods_median"],
            row["periods_max"],
        )
        for row in rows
    ]
    heads = ("fault", "sensors", "starts", "set aside", "shut", "another one", "unseen", "periods, median", "at most")
    return table(heads, found)
