"""The table of the control loop's latency in real time, stage by stage, beside the idle loop of the same run."""

from pathlib import Path
from typing import Any, Final

from benchmarks.common.markdown import read, table
from firmware_sim.latency.report import LABELS
from firmware_sim.latency.stages import Stage

CONTROLLERS: Final = {"onnx": "ONNX Runtime", "c": "C library"}
QUANTILES: Final = ("p50_ms", "p99_ms", "p99_9_ms", "max_ms")
HEADS: Final = ("", "p50", "p99", "p99.9", "max", "misses", "p50", "p99", "p99.9", "max", "misses")


def tables(results: Path) -> dict[str, str]:
    """By its marker."""
    return {"latency": latency(read(results / "latency.json"))}


def latency(found: Any) -> str:
    """A row for each stage and the idle loop, ONNX Runtime to the left, the C library to the right; below, verdicts."""
    runs = [found["figures"][name] for name in CONTROLLERS]
    rows = [
        (LABELS[Stage(stage)], *(cell for run in runs for cell in _cells(run["stages"][stage])))
        for stage in runs[0]["stages"]
    ]
    rows.append(("idle loop of the same run", *(cell for run in runs for cell in _cells(run["baseline"]))))
    lines = [
        f"{label}, {run['periods']} periods. {run['verdict']}\n"
        for label, run in zip(CONTROLLERS.values(), runs, strict=True)
    ]
    about = f"Measured on {found['date']}, {found['facts']['machine']}; left ONNX Runtime, right the C library; in ms."
    return "\n".join((about, "", table(HEADS, rows), "", *lines)).rstrip("\n")


def _cells(row: Any) -> tuple[str, ...]:
    times = (("never" if row[name] is None else f"{row[name]:.2f}") for name in QUANTILES)
    return (*times, str(row["misses"]))
