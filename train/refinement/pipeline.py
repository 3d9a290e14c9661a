"""The refinement of a trained model: distillation for its sensors, training of the prior with gradients through the
flow solver, and a fit of the prior's predictor."""

import hashlib
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
import scipy.linalg

from contract.arrays import Array
from contract.config.learning import RefineConfig
from contract.config.tree import Config
from contract.controller.goal import DEAREST_EFFORT, DEAREST_LIFT, Goal
from contract.differentiable import DifferentiableFlow, FlowState
from contract.errors import ConfigError, DatasetError, StillwakeError
from contract.model import model_folder
from contract.model.model_folder import AIR_SPEED, RESTING
from contract.recording import dataset
from contract.recording.findings import trainable
from contract.sensor_layout import SensorLayout
from train import model_store
from train.distillation.evaluate import evaluate_model
from train.fitting.fit import torch_threads, without_denormals
from train.fitting.progress import Phase, Progress, silent
from train.fitting.unfinished import Checkpoints, Identity
from train.model_store import TrainedModel
from train.networks.samples import prepare
from train.pipeline import deployed, versions
from train.refinement import air_speed
from train.refinement.feedback import Feedback, scales_of
from train.refinement.refine import SideBySide, refine
from train.selection.shap_ranking import GIVEN, SensorChoice

SPEEDS_AT_REST: Final = 9


def refine_model(
    model: TrainedModel,
    dataset_path: Path,
    config: Config,
    output: Path,
    *,
    sensors: Sequence[str],
    flow: Callable[[Sequence[str]], tuple[DifferentiableFlow, Sequence[FlowState]]],
    workers: SideBySide | None = None,
    progress: Progress = silent,
    resume: bool = True,
    threads: int = 1,
    begins_with: Mapping[str, str] | None = None,
) -> tuple[TrainedModel, int]:
    """Train a prior of the plan for a model, and store the model at `output`. Returns the model and the number of
    control periods for which the plant was run.

    If the model already has a prior with these sensors and with the sizes in `config`, the training begins with that
    prior. If the model has other sensors, a slim encoder for these sensors is distilled first, then slim dynamics and
    decoder for this encoder. The teacher stays unchanged. The run's state is stored in `<output>.checkpoints`.

    Args:
        model: trained model; the result keeps the model's other settings.
        dataset_path: recording that the model was fitted to.
        config: settings of the refinement, its seed (`train.seed`), and the settings of the exported controller.
        sensors: names of the sensors, in pairs of mirror images.
        flow: function that returns the plant with these sensors, and for each stream a developed wake without jets.
        workers: function that runs an update's closed-loop intervals in parallel; if None, they run in turn.
        resume: whether an interrupted run is continued; if False, the run starts over.
        begins_with: hashes of the initial model and flow, by name; a run with other hashes is not continued.

    Raises ConfigError if the interrupted run has other settings or another initial model or flow, or a price is too
    high; DatasetError if the model was fitted to another recording, or the sensors are not pairs of mirror images;
    PlantError if the flow diverged; StillwakeError if a file cannot be written.
    """
    check_pairs(model.layout, sensors)
    check_prices(config.refine)
    model_folder.check_free(output)
    trained = replace(model.config.train, seed=config.train.seed)
    settings = replace(model.config, train=trained, refine=config.refine, mpc=config.mpc)
    own = {"refine": asdict(settings.refine), **(begins_with or {})}
    identity = Identity.of(settings, model.dataset_sha256, "cpu", sensors, threads, own)
    checkpoints = Checkpoints.of(output, identity, resume)
    with torch_threads(threads), without_denormals():
        if tuple(sensors) != model.sensors:
            model = _with_sensors(model, dataset_path, settings, sensors, progress, checkpoints)
            model = replace(model, prior=None)
        plant, starts = flow(sensors)
        middles, deviations = middles_and_deviations(model, sensors)
        scales = scales_of(deviations[::2].tolist(), settings.flow.action_limit)
        refined = refine(
            partial(_begun, settings, scales, middles, model.prior),
            plant,
            starts,
            settings.refine,
            deviations,
            seed=settings.train.seed,
            side_by_side=workers,
            progress=progress,
            checkpoints=checkpoints,
        )
        prior = refined.feedback.as_prior()
        prior["predictor"] = predictor(refined.stretches, settings.refine.memory)
        resting = resting_by_speed(plant, starts[0], settings, progress)
        if resting is not None:
            prior[RESTING] = resting
            prior[AIR_SPEED] = air_speed_of(plant, starts, refined.feedback, settings, progress)
        model = replace(model, config=settings, prior=prior, versions={**model.versions, **versions()})
        model_store.save(output, model)
    shutil.rmtree(checkpoints.folder, ignore_errors=True)
    return model, refined.periods


def middles_and_deviations(model: TrainedModel, sensors: Sequence[str]) -> tuple[tuple[float, ...], Array]:
    """Return, in Cp, the means (p,) of the sums of p sensor pairs and the standard deviations (2 p,) of the sensors in
    the recording that the model was fitted to."""
    columns = list(model.layout.indices(sensors))
    means, deviations = (np.array(each)[columns] for each in (model.scaling.pressure_mean, model.scaling.pressure_std))
    return tuple((means[::2] + means[1::2]).tolist()), deviations


def resting_by_speed(flow: DifferentiableFlow, start: FlowState, settings: Config, progress: Progress) -> Array | None:
    """Return a table (K, 3) of the wake without jets at K speeds. Its columns are the speed, the base's mean Cp, and
    the pairs' mean |Cp difference|. Returns None if there is only one speed or no sensor is on the base."""
    slowest, fastest = settings.refine.slowest, settings.refine.fastest
    if slowest == fastest:
        return None
    speeds, rows = np.union1d(np.linspace(slowest, fastest, SPEEDS_AT_REST).round(6), [1.0]), []
    for done, speed in enumerate(speeds, 1):
        seen = flow.at_rest(start, float(speed))
        if seen is None:
            return None
        rows.append((speed, *seen))
        progress(Phase.REST, done, len(speeds), {})
    return np.array(rows)


def air_speed_of(
    flow: DifferentiableFlow, starts: Sequence[FlowState], feedback: Feedback, settings: Config, progress: Progress
) -> Array:
    """Return the weights of the air-speed estimate under this feedback (`contract.controller.air_speed`)."""
    seed, goal = settings.train.seed, Goal.of(settings.mpc.weights)
    found = list[tuple[Array, Array]]()
    for number in range(air_speed.RUNS):
        found.append(air_speed.run(flow, feedback, starts, settings.refine, goal, seed=seed, number=number))
        progress(Phase.AIR_SPEED, len(found), air_speed.RUNS, {})
    return air_speed.fit(found, feedback.pairs, seed=seed)[0]


def _begun(
    settings: Config, scales: tuple[float, ...], middles: tuple[float, ...], prior: Mapping[str, Array] | None
) -> Feedback:
    """Return the initial feedback: the model's prior if its sizes are suitable, otherwise a feedback with actions 0."""
    size = settings.refine
    made = Feedback(size.memory, size.units, scales, middles, settings.flow.action_limit, settings.train.seed)
    if prior is not None and "filters" in prior and len(prior["output"]) <= size.units:
        filters = made.as_prior()["filters"]
        if np.array_equal(prior["filters"], filters) and prior["first"].shape[-1] == len(scales):
            made.begin_with(prior)
    return made


def _with_sensors(
    model: TrainedModel,
    dataset_path: Path,
    settings: Config,
    sensors: Sequence[str],
    progress: Progress,
    checkpoints: Checkpoints,
) -> TrainedModel:
    recording = dataset.read(dataset_path)
    if hashlib.sha256(dataset_path.read_bytes()).hexdigest() != model.dataset_sha256:
        raise DatasetError(f"{dataset_path} is not the recording that the model was fitted to: name that recording")
    layout = recording.layout
    rows = prepare(trainable(recording, settings), model.scaling, mirrored=layout.mirror is not None, layout=layout)
    slim, narrow = deployed(
        model.teacher, sensors, rows, model.scaling, settings, progress=progress, checkpoints=checkpoints
    )
    test_rows = prepare(recording.with_role("test"), model.scaling, mirrored=False, layout=layout)
    return replace(
        model,
        slim=slim,
        predictor=narrow,
        sensors=tuple(sensors),
        metrics=evaluate_model(model.teacher, slim, narrow, test_rows, layout.indices(sensors)),
        ranking=SensorChoice(method=GIVEN, order=tuple(sensors)),
    )


PREDICTOR_RIDGE: Final = 1e-6
"""Ridge of the regression, relative to the mean squares of the regressors."""


def are_pairs(layout: SensorLayout, sensors: Sequence[str]) -> bool:
    """Return whether the sensors are pairs of mirror images, as `check_pairs` requires."""
    try:
        check_pairs(layout, sensors)
    except DatasetError:
        return False
    return True


def check_pairs(layout: SensorLayout, sensors: Sequence[str]) -> None:
    """Check that the sensors are pairs of mirror images, one pair after the other. Raises ConfigError if a name does
    not exist or is named twice; DatasetError if the two sensors of a pair are not mirror images of each other."""
    if layout.mirror is None:
        raise DatasetError("the sensors have no mirror images: a prior needs pairs of a sensor and its mirror image")
    columns = layout.indices(sensors)
    if len(sensors) < 2 or len(sensors) % 2:
        raise DatasetError(f"the {len(sensors)} sensors must be pairs of mirror images")
    for first, second in zip(columns[::2], columns[1::2], strict=True):
        if layout.mirror[first] != second or first == second:
            raise DatasetError(
                f"sensors {layout.names[first]} and {layout.names[second]} are not a pair: the mirror image of "
                f"{layout.names[first]} is {layout.names[layout.mirror[first]]}"
            )


def check_prices(settings: RefineConfig) -> None:
    """Raise ConfigError for a price above the range that a prior reads (`contract.controller.goal`)."""
    for name, most in (("lift_price", DEAREST_LIFT), ("effort_price", DEAREST_EFFORT)):
        if (price := getattr(settings, name)) > most:
            raise ConfigError(f"refine.{name} = {price:g}: must be at most {most:g}, a prior's highest input")


def predictor(stretches: Sequence[Array], memory: int) -> Array:
    """Fit the prior's predictor of p pressure differences y by ridge regression. The model is autoregressive with the
    action a as input: y_{k+1} = sum over i = 0 .. M-1 of C_i (y_{k-i}, a_{k-i}). Returns the coefficients C_i with the
    oldest row first, (p, M, p + 1). Mirror images of the flow are not needed: they change only the signs of y and a,
    and the model has no constant term, so they would give the same fit.

    `stretches` are arrays of n rows (y_k, a_k), (n, p + 1) each; all M rows of a prediction are from one array. Raises
    StillwakeError for fewer steps than coefficients, or a regressor that is always zero.
    """
    columns = stretches[0].shape[1]
    size = memory * columns
    steps = sum(max(0, len(rows) - memory) for rows in stretches)
    if steps < size:
        raise StillwakeError(f"{steps} control steps are too few to fit {size} coefficients: must be at least {size}")
    gram, moment = np.zeros((size, size)), np.zeros((size, columns - 1))
    for rows in stretches:
        if len(rows) > memory:
            windows = np.lib.stride_tricks.sliding_window_view(rows, memory, axis=0)[:-1]
            regressors = windows.transpose(0, 2, 1).reshape(len(windows), -1)
            gram += regressors.T @ regressors
            moment += regressors.T @ rows[memory:, :-1]
    scale = np.sqrt(np.diag(gram) / steps)
    if not (scale > 0).all():
        raise StillwakeError(f"column {int(np.flatnonzero(scale == 0)[0]) % columns} is zero in all rows")
    scaled = gram / np.outer(scale, scale) / steps
    solved = scipy.linalg.solve(
        scaled + PREDICTOR_RIDGE * np.eye(size), moment / scale[:, None] / steps, assume_a="pos"
    )
    return np.asarray((solved / scale[:, None]).T).reshape(-1, memory, columns)
