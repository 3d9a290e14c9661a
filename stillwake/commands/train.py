"""The command that trains the model offline."""

from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer
from rich.table import Table

from contract.config.loading import to_tree
from contract.config.loading import training as training_settings
from contract.shipped import recording as shipped_recording
from contract.typed import untyped
from stillwake.console import options as shared
from stillwake.console.outputs import check_apart, check_json, save_json
from stillwake.console.progress import progress
from stillwake.console.settings import settings
from stillwake.console.stopping import go_on_with
from stillwake.console.terminal import console
from stillwake.parts.training import TrainingProgress, advice, check_model_output
from train.fitting import unfinished

if TYPE_CHECKING:
    # These imports are for types only: torch takes seconds to load, and a vehicle's computer has no HDF5.
    from train.distillation.evaluate import ModelMetrics


USES: Final = ("model", "train", "mpc", "flow", "operating_point", "ecu.compute_time_ms")
"""Settings that the training uses, or that the model stores for its export."""


def train(
    output: Annotated[Path, typer.Argument(help="Model directory to write.")],
    dataset: shared.DataSet = None,
    device: Annotated[str, typer.Option(help="cpu or cuda.")] = "cpu",
    sensors: shared.Sensors = None,
    quick: Annotated[bool, typer.Option("--quick", help="Train in a third of the time, less accurately.")] = False,
    threads: shared.Threads = 1,
    restart: shared.Restart = False,
    overwrite: shared.Overwrite = False,
    json_file: shared.JsonFile = None,
    given: shared.Settings = [],  # noqa: B006
) -> None:
    """Train the model of the wake offline, from a recording: joint fit, choice of sensors, distillation.

    The command can be stopped at any time. The same command continues from the last checkpoint, and the model is the
    same as without a stop. To change a setting use, for example, --set train.epochs=300. The model stores all settings,
    and `export` starts from them. If --sensors names sensors, train.selection has no effect. docs/how-to/train.md
    describes the steps.
    """
    # A vehicle's computer has no HDF5: these imports report the missing extra before a missing file is reported.
    from contract.recording.dataset import read
    from contract.recording.findings import findings, refuse_unfit

    config = settings("train", given, uses=USES, base=training_settings(quick=quick)).config
    recording = shipped_recording() if dataset is None else dataset
    chosen = shared.names_in(sensors)
    checkpoints = check_model_output(output, overwrite=overwrite)
    check_apart(output, json_file)
    check_json(json_file)
    # The recording is checked before torch is loaded, as far as this is possible without torch.
    read_from = read(recording)
    if chosen is not None:
        read_from.layout.indices(chosen)
    refuse_unfit(findings(read_from, config, choosing=chosen is None), str(recording))
    reached = None
    if not restart:
        identity = unfinished.Identity.of(config, sha256(recording.read_bytes()).hexdigest(), device, chosen, threads)
        reached = unfinished.check(checkpoints, identity)
        if reached is not None:
            console.print(f"continues from {checkpoints}: {reached}")

    from train.pipeline import train_all

    # Ten iterations of the longer unroll may take half a minute on a busy machine, so the averaging time is long.
    with go_on_with(lambda: advice(checkpoints)), progress("iterations", estimate_over=300.0) as report:
        show = TrainingProgress(report)
        how: dict[str, Any] = {"device": device, "resume": not restart, "chosen": chosen, "threads": threads}
        trained = train_all(recording, config, output, progress=show, notice=console.print, **how)
    stable = trained.ranking.stable or {}
    save_json(
        json_file,
        figures={
            "metrics": untyped(trained.metrics),
            "sensors": trained.sensors,
            "stable": stable,
            "phases": show.watch.figures(),
        },
        facts={
            "dataset_sha256": trained.dataset_sha256,
            "config": to_tree(config),
            "versions": trained.versions,
            "minutes": sum(one["min"] for one in show.watch.figures()),
            "resumed": reached is not None,
        },
    )
    console.print(_metrics_table(trained.metrics))
    sets = ", ".join(f"{size}: {'yes' if same else 'no'}" for size, same in stable.items())
    found = f"top sets identical over the repeats: {sets}" if sets else f"method: {trained.ranking.method}"
    console.print(f"sensors: {', '.join(trained.sensors)}   {found}")
    console.print(f"wrote {output}")


def _metrics_table(metrics: "ModelMetrics") -> Table:
    ahead = [f"h={item.horizon}" for item in metrics.teacher.rollout]
    table = Table("Cd, Cl", "R2", "L1/sigma", *ahead, title="test episodes; h = n: L1/sigma n steps ahead")
    for name, part in (("teacher", metrics.teacher), ("slim", metrics.slim), ("deployed", metrics.deployed)):
        if part is not None:
            r2, l1 = (part.drag.r2, part.lift.r2), (part.drag.l1_over_sigma, part.lift.l1_over_sigma)
            errors_ahead = (f"{item.drag:.2f} {item.lift:.2f}" for item in part.rollout)
            table.add_row(name, *(f"{of_drag:.3f} {of_lift:.3f}" for of_drag, of_lift in (r2, l1)), *errors_ahead)
    return table
