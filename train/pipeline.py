"""The training from a recording to a stored model: joint fit, choice of sensors, distillation, test errors."""

import hashlib
import platform
import shutil
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Final

import torch

from contract.config.tree import Config
from contract.model import model_folder
from contract.recording import dataset
from contract.recording.findings import findings, left_out, refuse_unfit, trainable
from contract.release.manifest import Scaling
from contract.sensor_layout import SensorLayout
from train import model_store
from train.distillation.distil import distil, encode_all
from train.distillation.evaluate import evaluate_model
from train.distillation.lessons import distil_predictor, teach
from train.fitting import unfinished
from train.fitting.fit import device_named, fit_joint, torch_threads
from train.fitting.progress import Phase, Progress, silent
from train.fitting.unfinished import Checkpoints, Identity
from train.model_store import TrainedModel
from train.networks.model import Encoder, Predictor, WakeModel
from train.networks.samples import Rows, fit_scaling, prepare
from train.selection.methods import select, select_by_hand
from train.selection.shap_ranking import GIVEN, Ranking, SensorChoice, check_count, rank

THREADS: Final = "torch_threads"
"""Key in a model's `versions` for the number of torch's threads. A resumed training may have used several numbers."""


def train_all(
    dataset_path: Path,
    config: Config,
    output: Path,
    *,
    progress: Progress = silent,
    device: str = "cpu",
    resume: bool = True,
    chosen: Sequence[str] | None = None,
    threads: int = 1,
    notice: Callable[[str], None] = lambda line: None,
) -> TrainedModel:
    """Train on a recording's "train" episodes, and on their mirror images if the sensors have mirror images. Test on
    the "test" episodes. Store the model at `output`, and return the model, on the CPU.

    The run's state is stored in `<output>.checkpoints`. An existing model at `output` is replaced when the new model is
    complete.

    Args:
        device: "cpu" or "cuda".
        resume: whether an interrupted run with equal settings and recording is continued; if False, the run starts
            over.
        chosen: names of the slim encoder's sensors; None uses the method `config.train.selection`.
        threads: number of torch's threads, stated in the model's `versions`; later the previous number is restored.
        notice: called with a line for every training episode that is too short, and if the number of threads has
            changed.

    Raises DatasetError if the recording is unreadable or unsuitable (`contract.recording.findings`), or the checkpoint
    belongs to another recording; ConfigError for an unknown device, absent CUDA, an unknown or repeated sensor, a
    checkpoint of another configuration, or fewer than one thread; TrainingError if the loss or a weight is not finite;
    StillwakeError if `output` cannot be written.
    """
    with torch_threads(threads):
        where = device_named(device)
        model_folder.check_free(output)
        recording = dataset.read(dataset_path)
        layout = recording.layout
        # Settings that a later phase would reject are checked before the first phase, which takes minutes.
        _check_selection(config, layout, chosen)
        refuse_unfit(findings(recording, config, choosing=chosen is None), str(dataset_path))
        for line in left_out(recording, config):
            notice(line)
        digest = hashlib.sha256(dataset_path.read_bytes()).hexdigest()
        episodes = trainable(recording, config)
        scaling = fit_scaling(episodes, layout)
        train_rows = prepare(episodes, scaling, mirrored=layout.mirror is not None, layout=layout)
        test_rows = prepare(recording.with_role("test"), scaling, mirrored=False, layout=layout)
        checkpoints = Checkpoints.of(output, Identity.of(config, digest, device, chosen, threads), resume)
        used = sorted({*unfinished.threads(checkpoints.folder), threads})
        if len(used) > 1:
            before = ", ".join(str(n) for n in used if n != threads)
            notice(f"torch used {before} threads, now {threads}: results may differ")
        rows = train_rows.to(where)
        teacher = fit_joint(rows, config, progress=progress, checkpoints=checkpoints)
        if chosen is None:
            names, choice = _choice(teacher.encoder, rows, config, checkpoints, progress)
        else:
            names, choice = tuple(chosen), SensorChoice(method=GIVEN, order=tuple(chosen))
        slim, predictor = deployed(teacher, names, rows, scaling, config, progress=progress, checkpoints=checkpoints)
        teacher = teacher.cpu()
        trained = TrainedModel(
            config=config,
            scaling=scaling,
            teacher=teacher,
            slim=slim,
            predictor=predictor,
            sensors=names,
            dataset_sha256=digest,
            metrics=evaluate_model(teacher, slim, predictor, test_rows, layout.indices(names)),
            ranking=choice,
            versions={**versions(), THREADS: ", ".join(map(str, used))},
            layout=layout,
        )
        model_store.save(output, trained)
        shutil.rmtree(checkpoints.folder, ignore_errors=True)
        return trained


def deployed(
    teacher: WakeModel,
    names: Sequence[str],
    rows: Rows,
    scaling: Scaling,
    config: Config,
    *,
    progress: Progress = silent,
    checkpoints: Checkpoints | None = None,
) -> tuple[Encoder, Predictor | None]:
    """Return the networks for the vehicle, on the CPU: an encoder for the named sensors, and narrower dynamics and
    decoder, or None if the settings have no slim widths. `rows` are training rows with all sensors' columns."""
    indices = rows.layout.indices(names)
    slim = distil(teacher.encoder, rows, indices, config, progress=progress, checkpoints=checkpoints)
    if not config.model.is_slimmed:
        return slim.cpu(), None
    # The roll-outs begin with latents of the vehicle's encoder, not with the teacher's latents.
    latents = encode_all(slim, rows.with_sensors(indices))
    lessons = teach(teacher, latents, rows, scaling, config, progress=progress)
    predictor = distil_predictor(lessons, config.model, config.train, progress=progress, checkpoints=checkpoints)
    return slim.cpu(), predictor.cpu()


def _check_selection(config: Config, layout: SensorLayout, chosen: Sequence[str] | None) -> None:
    if chosen is not None:
        layout.indices(chosen)
        return
    check_count(config.train.sensors, len(layout))
    if config.train.selection == "hand":
        select_by_hand(config.train.sensors, layout)


def _choice(
    encoder: Encoder, rows: Rows, config: Config, checkpoints: Checkpoints, progress: Progress
) -> tuple[tuple[str, ...], SensorChoice]:
    settings = config.train
    if settings.selection == "shap":
        state = checkpoints.load(Phase.RANK)
        if state is None:
            ranking = rank(encoder, rows, settings, progress=progress)
            checkpoints.save(Phase.RANK, {"scores": torch.from_numpy(ranking.scores)})
        else:
            ranking = Ranking(scores=state["scores"].numpy(), names=rows.layout.names)
        return ranking.top(settings.sensors), SensorChoice.of_ranking(ranking)
    state = checkpoints.load(Phase.SELECT)
    if state is None:
        names = select(encoder, rows, settings, progress=progress)
        # The values of mirror-image sensors differ only by rounding, so a resumed run might choose another order.
        checkpoints.save(Phase.SELECT, {"order": torch.from_numpy(rows.layout.indices(names))})
    else:
        names = tuple(rows.layout.names[index] for index in state["order"].tolist())
    return names, SensorChoice(method=settings.selection, order=names)


def versions() -> dict[str, str]:
    """Return the versions of the software that a training uses."""
    packages = {name: version(name) for name in ("stillwake", "torch", "numpy", "shap")}
    return {"python": platform.python_version(), **packages}
