"""The table of the control loop's latency in real time: each of its stages, and the idle loop in the same run."""

from pathlib import Path
from typing import Any, Final

from benchmarks.common.markdown import read, table
from firmware_sim.latency.report import LABELS
from firmware_sim.latency.stages import Stage

CONTROLLERS: Final = {"onnx": "ONNX Runtime", "c": "C library"}
QUANTILES: Final = ("p50_ms", "p99_ms", "p99_9_ms", "max_ms")
HEADS: Final = ("", "p50", "p99", "p99.9", "max", "misses", "p50", "p99", "p99.9", "max", "misses")


def tables(results: Path) -> dict[str, str]:
    """Return the table's text, by the table's name in the pages."""
    return {"latency": latency(read(results / "latency.json"))}


def latency(found: Any) -> str:
    """Return a table with a row for each stage and for the idle loop. The left columns are for ONNX Runtime, the right
    columns for C; the verdicts are below the table."""
    runs = [found["figures"][name] for name in CONTROLLERS]
    rows = [
        (LABELS[stage], *(cell for run in runs for cell in _cells(run["stages"][stage], _misses(run, stage))))
        for stage in Stage
    ]
    baselines = [run["baseline"] for run in runs]
    rows.append(("idle loop in the same run", *(cell for row in baselines for cell in _cells(row, row["misses"]))))
    lines = [
        f"{label}: {run['misses']} of {run['periods']} commands missed their boundary; {run['periods_planned']} "
        f"periods had a plan. In {run['baseline']['misses']} periods the idle loop was late by the slack of "
        f"{run['slack_ms']:.1f} ms or more.\n"
        for label, run in zip(CONTROLLERS.values(), runs, strict=True)
    ]
    release = runs[0]["about"].split()[0]
    about = (
        f"Times in ms; the left columns are for ONNX Runtime, the right columns for the C library. Measured on "
        f"{found['date']} with {release}, {found['facts']['machine']}."
    )
    return "\n".join((about, "", table(HEADS, rows), "", *lines)).rstrip("\n")


def _misses(run: Any, stage: Stage) -> int | str:
    return run["misses"] if stage is Stage.ALL else ""


def _cells(row: Any, misses: int | str) -> tuple[str, ...]:
    times = (("never" if row[name] is None else f"{row[name]:.2f}") for name in QUANTILES)
    return (*times, str(misses))
