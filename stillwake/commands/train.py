"""The command that trains the model offline."""

import time
from collections.abc import Mapping
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.progress import TaskID
from rich.table import Table

from contract.config.loading import load_config, to_tree
from contract.results import write_result
from stillwake.terminal import ConfigFile, JsonFile, Overrides, console, progress_bar
from wake.shipped import recording

if TYPE_CHECKING:
    # Loading torch takes seconds, which the other commands need not wait for.
    from train.evaluate import ModelMetrics


def train(
    output: Annotated[Path, typer.Argument(help="Model directory to write.")],
    dataset: Annotated[Path | None, typer.Option(help="HDF5 data set; default: the shipped recording.")] = None,
    device: Annotated[str, typer.Option(help="cpu or cuda.")] = "cpu",
    resume: Annotated[bool, typer.Option(help="Continue an interrupted training.")] = False,
    sensors: Annotated[str, typer.Option(help="Comma-separated sensors instead of the method's choice.")] = "",
    json_file: JsonFile = None,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Train the model of the wake offline, from a recording.

    Joint fit (paper, section 2.2): an LSTM encoder over the last 32 rows of
    90 pressures and the action, residual latent dynamics and a force decoder,
    together, on L_pred + force_weight L_force + variance_weight L_var +
    covariance_weight L_cov, unrolled over train.unroll steps; then
    train.finish.epochs more passes, unrolled over train.finish.unroll.

    Sensor selection (2.3.1): the best train.sensors by mean |SHAP| of the
    latents, train.shap_repeats times over; or train.selection = qr, greedy,
    random or hand.

    Distillation (2.3.2): a slim encoder on those sensors learns the latents
    of the fitted one; with model.slim_dynamics_width and
    model.slim_decoder_width, narrower dynamics and decoder learn its
    roll-outs.

    All are evaluated on the test episodes: R2 and L1/sigma of Cd and Cl, and
    open-loop roll-outs of 5, 10 and 25 steps. Settings default to the
    release's; --config takes a TOML file, --set one value, such as
    --set train.epochs=300. Seed, recording, settings and machine decide the
    model, also if the run is stopped and resumed.
    """
    from train.pipeline import train_all
    from train.progress import Phase

    began = time.monotonic()
    config = load_config(config_file, overrides)
    with progress_bar("iterations") as bar:
        tasks: dict[Phase, TaskID] = {}

        def show(phase: Phase, step: int, total: int, terms: Mapping[str, float]) -> None:
            if phase not in tasks:
                tasks[phase] = bar.add_task(phase.label, total=total, note="")
            note = "  ".join(f"{name} {value:.4f}" for name, value in terms.items())
            bar.update(tasks[phase], completed=step, note=note)

        trained = train_all(
            recording() if dataset is None else dataset,
            config,
            output,
            progress=show,
            device=device,
            resume=resume,
            chosen=tuple(name.strip() for name in sensors.split(",")) if sensors else None,
        )
    console.print(_metrics_table(trained.metrics))
    stable = trained.ranking.stable or {}
    if json_file is not None:
        write_result(
            json_file,
            figures={"metrics": trained.metrics.as_tree(), "sensors": trained.sensors, "stable": stable},
            facts={
                "dataset_sha256": trained.dataset_sha256,
                "config": to_tree(config),
                "versions": trained.versions,
                "minutes": (time.monotonic() - began) / 60.0,
            },
            on=date.today(),
        )
    sets = ", ".join(f"{size}: {'yes' if same else 'no'}" for size, same in stable.items())
    found = f"top sets identical over the repeats: {sets}" if sets else f"method: {trained.ranking.method}"
    console.print(f"sensors: {', '.join(trained.sensors)}   {found}")
    console.print(f"wrote {output}")


def _metrics_table(metrics: "ModelMetrics") -> Table:
    ahead = [f"h={item.horizon}" for item in metrics.teacher.rollout]
    table = Table("Cd, Cl", "R2", "L1/sigma", *ahead, title="test episodes; h = n: L1/sigma n steps ahead")
    for name, part in (("teacher", metrics.teacher), ("slim", metrics.slim), ("deployed", metrics.deployed)):
        if part is not None:
            errors_ahead = (f"{item.drag:.2f} {item.lift:.2f}" for item in part.rollout)
            table.add_row(
                name,
                f"{part.drag.r2:.3f} {part.lift.r2:.3f}",
                f"{part.drag.l1_over_sigma:.3f} {part.lift.l1_over_sigma:.3f}",
                *errors_ahead,
            )
    return table
