"""The command that trains a model's prior through the flow."""

from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Final

import typer

from contract.atomic import check_writable
from contract.config.loading import load_config, to_tree
from contract.errors import ConfigError
from contract.model.model_folder import check_free
from contract.results import versions
from contract.shipped import model as shipped_model
from contract.shipped import recording as shipped_recording
from stillwake.console.claims import claim
from stillwake.console.outputs import Overwrite, check_json, check_output, save_json
from stillwake.console.settings import settings
from stillwake.console.terminal import ConfigFile, JsonFile, Overrides, Threads, console, progress_bar
from stillwake.parts.training_progress import PhaseBars, continued
from train.fitting import unfinished

SENSORS: Final = 4
"""How many are taken where none are named."""
USES: Final = ("refine", "mpc", "train.seed")


def refine(
    output: Annotated[Path, typer.Argument(help="Model directory to write.")],
    model: Annotated[Path | None, typer.Option(help="Model directory to refine. Default: the shipped one.")] = None,
    sensors: Annotated[
        str | None,
        typer.Option(
            help="Comma-separated sensors, in pairs of mirror images. Default: the rearmost pair on the sides and the "
            "outermost on the base."
        ),
    ] = None,
    dataset: Annotated[
        Path | None, typer.Option(help="Data set that the model was trained on. Default: the shipped recording.")
    ] = None,
    start: Annotated[
        Path | None,
        typer.Option(
            help="Developed wake (.npz) on the default mesh. Default: the shipped one; another body's than the truck's "
            "develops from rest, on the mesh of the training."
        ),
    ] = None,
    threads: Threads = 1,
    workers: Annotated[
        int, typer.Option(min=1, help="Processes that share the stretches of an update (refine.batch).")
    ] = 1,
    restart: Annotated[
        bool, typer.Option("--restart", help="Delete the checkpoints of a run that was stopped, and start over.")
    ] = False,
    overwrite: Overwrite = False,
    json_file: JsonFile = None,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Train through the flow where a model's controller starts from.

    In closed loop with the flow solver, a small feedback learns by the exact
    gradient of drag. In the controller it gives the plan that the optimiser
    starts from. It can be stopped at any time; the same command goes on.
    docs/explanation/through-the-flow.md describes it.
    """
    from train import model_store
    from train.refinement.pipeline import refine_model

    claim(output, folder=True)
    check_free(output)
    check_output(output, overwrite=overwrite, folder=True, occupant="there is a model already")
    folder = unfinished.folder_of(output)
    check_writable(folder, folder=True)
    check_json(json_file)
    folder_read = shipped_model() if model is None else model
    trained = model_store.load(folder_read)
    own = trained.config
    if trained.prior is None:
        # What its optimiser was set to moves a plan from period to period; from a prior it has less to do.
        kept = own.mpc
        mpc = replace(load_config().mpc, horizon=kept.horizon, drag_reference=kept.drag_reference)
        own = replace(own, mpc=mpc)
    config = settings("refine", config_file, overrides, uses=USES, base=own).config
    if (config.body, config.flow) != (own.body, own.flow):
        raise ConfigError(
            f"{config_file}: its body or flow is not that of model {folder_read}: name a model of it with --model"
        )

    from stillwake.parts.differentiable_wake import differentiable_wake, wake_of
    from train.refinement.stretches import side_by_side
    from train.selection.methods import select_by_hand

    layout = trained.layout
    if sensors is None:
        names = tuple(layout.names[index] for index in select_by_hand(SENSORS, layout))
    else:
        names = tuple(name.strip() for name in sensors.split(","))
    shared = side_by_side(workers, partial(wake_of, config, names)) if workers > 1 else nullcontext()
    with continued(folder), shared as run, progress_bar("steps", estimate_over=600.0) as bar:
        show = PhaseBars(bar)
        settling = bar.add_task("wake on its mesh", total=1.0, note="")
        refined, periods = refine_model(
            trained,
            shipped_recording() if dataset is None else dataset,
            config,
            output,
            sensors=names,
            flow=partial(
                differentiable_wake,
                config,
                start=start,
                progress=lambda t, total: bar.update(settling, completed=t / total),
            ),
            workers=run,
            progress=show,
            resume=not restart,
            threads=threads,
        )
    save_json(
        json_file,
        figures={"phases": show.watch.figures(), "periods": periods, "sensors": refined.sensors},
        facts={
            "dataset_sha256": refined.dataset_sha256,
            "config": to_tree(refined.config),
            "versions": versions("stillwake", "torch", "numpy", "numba"),
        },
    )
    console.print(f"{periods} control periods of the plant")
    console.print(f"wrote {output}")
