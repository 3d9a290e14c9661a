"""The closed loop with each implementation of one model's controller: the effects of int8 and of the C library on drag.

    python -m benchmarks controller-loop [--model DIR] [--dataset H5] [--json FILE]

The benchmark exports the model in float32 and in int8, each as bundle and C library, and runs the closed loop with each
of these four controllers, as `stillwake run` does. Exports and runs are stored in `runs/controller_loop`, in a folder
named after the model's hash, so that an interrupted measurement can continue. The steps' wall-clock times are from one
run each. Close all other programs before you quote these times, or use the times of `python -m benchmarks controller`,
which measures all implementations in turn.
"""

from pathlib import Path
from typing import Annotated, Any, Final

import typer

from benchmarks.common.command_line import LOOP, JsonFile, Parts, console, report, stillwake
from benchmarks.common.documents import read
from benchmarks.controller import tables
from contract.model import model_folder
from contract.results import versions
from contract.shipped import MODEL, RECORDING

CASES: Final = (("onnx", "float32"), ("onnx", "int8"), ("c", "float32"), ("c", "int8"))
"""Implementation and precision of each loop; all differences are relative to the first loop."""
ALLOWED_POINTS: Final = 0.5
"""Largest allowed change of the drag reduction from float32 to int8, in percentage points."""
_KEPT: Final = (*LOOP, "Cd_uncontrolled", "abs_Cl_uncontrolled", "mpc_ms_p50", "mpc_ms_p99", "computed_by")


def main(
    model: Annotated[Path, typer.Option(help="Model folder written by `stillwake train`.")] = MODEL,
    dataset: Annotated[Path, typer.Option(help="Recording to take windows from.")] = RECORDING,
    json_file: JsonFile = None,
    parts: Parts = Path("runs/controller_loop"),
    lead_in: Annotated[float, typer.Option(help="Time without control, t_c.")] = 25.0,
    controlled: Annotated[float, typer.Option(help="Time with control, t_c.")] = 100.0,
    settle: Annotated[float, typer.Option(help="Time left out of the controlled averages, t_c.")] = 40.0,
) -> None:
    """Run the four closed loops and print a table."""
    weights = model_folder.read(model).weights_sha256
    folder = parts / weights[:12]
    for precision in ("float32", "int8"):
        bundle, library = folder / f"bundle_{precision}", folder / f"c_{precision}"
        # The bundle is written last, so an existing bundle means that the export is complete.
        if not bundle.exists():
            # An interrupted export may have left a library in the folder, so `--overwrite` is needed.
            options = ("--c", library, "--precision", precision, "--dataset", dataset, "--overwrite")
            stillwake("export", model, bundle, *options)
    spans = {"lead_in": lead_in, "controlled": controlled, "settle": settle}
    rows = [_run(folder, lowering, precision, spans) for lowering, precision in CASES]
    for row in rows:
        row["points"] = row["reduction_percent"] - rows[0]["reduction_percent"]
    facts = {**spans, "weights_sha256": weights, "versions": versions("stillwake", "onnxruntime", "numpy", "numba")}
    report(json_file, rows, facts, tables.loop)
    worst = max(abs(row["points"]) for row in rows if row["precision"] == "int8")
    verdict = "within" if worst <= ALLOWED_POINTS else "NOT within"
    console.print(f"int8 changes the reduction by {worst:.2f} percentage points: {verdict} {ALLOWED_POINTS}")


def _run(folder: Path, lowering: str, precision: str, spans: dict[str, float]) -> dict[str, Any]:
    """Return the figures of one closed loop. They are read from a file; if it does not exist, the loop is run first."""
    length = "_".join(f"{span:g}" for span in spans.values())
    run = folder / f"run_{lowering}_{precision}_{length}"
    found = run.with_name(f"{run.name}.json")
    if not found.exists():
        library = ("--library", folder / f"c_{precision}") if lowering == "c" else ()
        options = [word for name, span in spans.items() for word in (f"--{name.replace('_', '-')}", span)]
        used = ("--bundle", folder / f"bundle_{precision}", *library)
        stillwake("run", run, "--overwrite", *used, *options, "--json", found)
    figures = read(found)["figures"]
    return {"lowering": lowering, "precision": precision, **{name: figures[name] for name in _KEPT}}
