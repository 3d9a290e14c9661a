"""The command that trains a model's prior with gradients through the flow simulation."""

from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Annotated, Final

import typer

from contract.config.loading import load_config, to_tree
from contract.errors import ConfigError, DatasetError
from contract.model.model_folder import MODEL_WEIGHTS
from contract.shipped import model as shipped_model
from contract.shipped import recording as shipped_recording
from stillwake.console import options as shared
from stillwake.console.outputs import check_apart, check_json, save_json
from stillwake.console.progress import progress
from stillwake.console.settings import settings
from stillwake.console.stopping import go_on_with
from stillwake.console.terminal import console
from stillwake.parts.training import TrainingProgress, advice, check_model_output

USES: Final = ("refine", "mpc", "train.seed")


def refine(
    output: Annotated[Path, typer.Argument(help="Model directory to write.")],
    model: Annotated[Path | None, typer.Option(help="Model directory to refine; default: the shipped model.")] = None,
    sensors: shared.Sensors = None,
    dataset: shared.DataSet = None,
    state: shared.State = None,
    threads: shared.Threads = 1,
    workers: Annotated[int, typer.Option("--workers", min=1, help="Processes that share refine.batch.")] = 1,
    restart: shared.Restart = False,
    overwrite: shared.Overwrite = False,
    json_file: shared.JsonFile = None,
    given: shared.Settings = [],  # noqa: B006
) -> None:
    """Train a model's prior with gradients through the flow solver.

    The prior is a small feedback that gives the plan from which the controller's optimiser starts. The prior runs in
    closed loop with the flow solver, and learns from the exact gradient of the drag. The command can be stopped at any
    time; the same command continues. docs/explanation/through-the-flow.md describes the method. --sensors must name
    pairs of mirror images. The default is the model's sensors if they are such pairs, otherwise two pairs next to the
    rear edges. --dataset is the model's training data; the flow of --state must be on the default grid.
    """
    from train import model_store
    from train.refinement.pipeline import are_pairs, refine_model

    folder = check_model_output(output, overwrite=overwrite)
    check_apart(output, json_file)
    check_json(json_file)
    folder_read = shipped_model() if model is None else model
    check_apart(folder_read, None if output.exists() and output.samefile(folder_read) else output)
    trained = model_store.load(folder_read)
    if dataset is not None and sha256(dataset.read_bytes()).hexdigest() != trained.dataset_sha256:
        raise DatasetError(f"{dataset} is not the recording that the model was fitted to: name that recording")
    own = trained.config
    if trained.prior is None:
        # A model without a prior has settings for an optimiser that starts from its own plan of the previous period. An
        # optimiser that starts from a prior's plan has less to improve, so defaults replace most of these settings.
        kept = own.mpc
        mpc = replace(load_config().mpc, horizon=kept.horizon, drag_reference=kept.drag_reference)
        own = replace(own, mpc=mpc)
    config = settings("refine", given, uses=USES, base=own).config
    if (config.body, config.flow) != (own.body, own.flow):
        raise ConfigError(f"--set: body or flow differ from the model {folder_read}: give another model with --model")

    from stillwake.parts.differentiable_wake import differentiable_wake, wake_of
    from train.refinement.refine import side_by_side
    from train.selection.methods import select_by_hand

    begins_with = {"model": folder_read / MODEL_WEIGHTS, **({} if state is None else {"state": state})}
    layout = trained.layout
    names = shared.names_in(sensors) or (trained.sensors if are_pairs(layout, trained.sensors) else ())
    names = names or tuple(layout.names[index] for index in select_by_hand(4, layout))
    spread = side_by_side(workers, partial(wake_of, config, names)) if workers > 1 else nullcontext()
    with go_on_with(lambda: advice(folder)), spread as run, progress("steps", estimate_over=600.0) as report:
        show, settling = TrainingProgress(report), partial(report, "wake on its grid", unit="t_c")
        refined, periods = refine_model(
            trained,
            shipped_recording() if dataset is None else dataset,
            config,
            output,
            sensors=names,
            flow=partial(differentiable_wake, config, start=state, progress=settling),
            workers=run,
            progress=show,
            resume=not restart,
            threads=threads,
            begins_with={name: sha256(file.read_bytes()).hexdigest()[:16] for name, file in begins_with.items()},
        )
    save_json(
        json_file,
        figures={"phases": show.watch.figures(), "periods": periods, "sensors": refined.sensors},
        facts={"dataset_sha256": refined.dataset_sha256, "config": to_tree(refined.config)},
        packages=("stillwake", "torch", "numpy", "numba"),
    )
    console.print(f"{periods} control periods of the plant")
    console.print(f"wrote {output}")
