"""The training loop, and the joint fit of encoder, dynamics and decoder (paper, section 2.2.4).

A run is a function of configuration and recording. Batches depend only on the seed and the step. Initial weights and
dropout depend on a generator that this module seeds and that the checkpoint stores. On one machine and with one number
of threads, a run that is interrupted and resumed therefore ends with the weights of an uninterrupted run. On another
machine or with another number of threads, sums may be added in another order.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Literal

import torch
from torch import Tensor, nn

from contract.config.learning import TrainConfig
from contract.config.tree import Config
from contract.errors import ConfigError, TrainingError
from train.fitting import checkpoint, unfinished
from train.fitting.progress import Phase, Progress, silent
from train.fitting.unfinished import Reached
from train.networks.loss import joint_loss
from train.networks.model import WakeModel
from train.samples.rows import Rows
from train.samples.sampler import SegmentSampler

REPORT_EVERY = 10
"""Number of steps between progress reports. Reports are rare because reading the loss waits for the device."""


@dataclass(frozen=True, kw_only=True)
class Checkpoints:
    """The folder in which a phase stores its state, and the number of steps between two checkpoints.

    Attributes:
        folder: folder of the checkpoint files, one per phase.
        identity: settings and recording of the run.
        resume: whether the phase continues from existing checkpoints; otherwise it starts over.
        every: number of steps between two checkpoints.
    """

    folder: Path
    identity: checkpoint.Identity
    resume: bool = False
    every: int = 100

    def path(self, phase: Phase) -> Path:
        return self.folder / f"{phase}.pt"


@dataclass(frozen=True, kw_only=True)
class Schedule:
    """The learning rate of Adam over the run: constant, or one cycle (warm-up, then cosine to zero; Smith 2017)."""

    steps: int
    learning_rate: float
    shape: Literal["constant", "one_cycle"]


def device_named(name: str) -> torch.device:
    """Return the device "cpu" or "cuda". Raises ConfigError for another name, or if CUDA is absent."""
    if name not in ("cpu", "cuda"):
        raise ConfigError(f"device {name!r}: must be 'cpu' or 'cuda'")
    if name == "cuda" and not torch.cuda.is_available():
        raise ConfigError("device 'cuda' was asked for, but this machine or this build of torch has no CUDA")
    return torch.device(name)


@contextmanager
def seeded(seed: int, device: torch.device) -> Iterator[None]:
    """Seed torch's random numbers inside the block; the caller's generators are restored after it."""
    with torch.random.fork_rng(devices=[device] if device.type == "cuda" else []):
        torch.manual_seed(seed)
        yield


def optimise(
    module: nn.Module,
    loss: Callable[[int], Mapping[str, Tensor]],
    schedule: Schedule,
    *,
    phase: Phase,
    progress: Progress = silent,
    checkpoints: Checkpoints | None = None,
) -> None:
    """Minimise `loss(step)["total"]` over the module's parameters with Adam, in place.

    Call this function inside `seeded`: the generator's state is saved and restored with the checkpoint. Raises
    ConfigError, DatasetError or StillwakeError for a checkpoint that does not fit (`train.fitting.checkpoint`);
    TrainingError as soon as loss or weights are not finite, and then removes the checkpoints.
    """
    optimiser = torch.optim.Adam(module.parameters(), lr=schedule.learning_rate)
    rate = _rate(optimiser, schedule)
    first = 0
    if checkpoints is not None and checkpoints.resume:
        state = checkpoint.load(checkpoints.path(phase), checkpoints.identity)
        if state is not None:
            module.load_state_dict(state["module"])
            optimiser.load_state_dict(state["optimiser"])
            rate.load_state_dict(state["rate"])
            _set_generators(state["generators"])
            first = state["step"]
    module.train()
    for step in range(first, schedule.steps):
        terms = loss(step)
        done = step + 1
        is_kept = checkpoints is not None and (done % checkpoints.every == 0 or done == schedule.steps)
        # The loss is read rarely on a GPU, because each reading waits until the GPU has finished its work.
        if terms["total"].device.type == "cpu" or done % REPORT_EVERY == 0 or is_kept:
            _check_finite(terms["total"], phase, step, schedule, checkpoints)
        optimiser.zero_grad()
        torch.autograd.backward(terms["total"])
        optimiser.step()
        rate.step()
        if done % REPORT_EVERY == 0 or done == schedule.steps:
            progress(phase, done, schedule.steps, {name: value.item() for name, value in terms.items()})
        if checkpoints is not None and is_kept:
            for parameter in module.parameters():
                _check_finite(parameter, phase, done, schedule, checkpoints)
            state = {
                "module": module.state_dict(),
                "optimiser": optimiser.state_dict(),
                "rate": rate.state_dict(),
                "generators": _generators(),
                "step": done,
            }
            checkpoint.save(checkpoints.path(phase), checkpoints.identity, state)
            unfinished.note(
                checkpoints.folder, checkpoints.identity, Reached(phase=phase, step=done, total=schedule.steps)
            )
    module.eval()


def _check_finite(value: Tensor, phase: Phase, step: int, schedule: Schedule, checkpoints: Checkpoints | None) -> None:
    if not torch.isfinite(value).all():
        if checkpoints is not None:
            # A run that continues from these checkpoints with unchanged settings would fail again.
            unfinished.clear(checkpoints.folder)
        raise TrainingError(
            f"{phase.label}: the loss is not finite after {step} of {schedule.steps} iterations with "
            f"train.learning_rate = {schedule.learning_rate:g}: choose a lower one, the paper's is 0.001"
        )


def fit_joint(
    rows: Rows,
    config: Config,
    *,
    progress: Progress = silent,
    checkpoints: Checkpoints | None = None,
) -> WakeModel:
    """Train encoder, dynamics and decoder together on standardised rows; the result is in evaluation mode.

    The training runs on the device of `rows`. Raises DatasetError if an episode is too short for window and unroll.
    """
    settings, device = config.train, rows.inputs.device
    with seeded(settings.seed, device):
        model = WakeModel(rows.inputs.shape[1] - 1, config.model).to(device)
        _fit(model, rows, config.model.window, settings, Phase.FIT, progress, checkpoints)
        if settings.finish.epochs:
            # Each field of `finish` replaces the setting with that name. This last part of training reads windows, as
            # on the vehicle.
            last = replace(settings, streamed=False, **asdict(settings.finish))
            _fit(model, rows, config.model.window, last, Phase.FINISH, progress, checkpoints)
    return model


def _fit(
    model: WakeModel,
    rows: Rows,
    window: int,
    settings: TrainConfig,
    phase: Phase,
    progress: Progress,
    checkpoints: Checkpoints | None,
) -> None:
    sampler = SegmentSampler(
        rows,
        window=window,
        ahead=settings.unroll,
        segment=settings.segment,
        batch_size=settings.batch_size,
        seed=settings.seed,
    )
    schedule = Schedule(
        steps=sampler.steps(settings.epochs), learning_rate=settings.learning_rate, shape=settings.schedule
    )
    optimise(
        model,
        lambda step: joint_loss(model, sampler.batch(step), settings).as_dict(),
        schedule,
        phase=phase,
        progress=progress,
        checkpoints=checkpoints,
    )


def _rate(optimiser: torch.optim.Optimizer, schedule: Schedule) -> torch.optim.lr_scheduler.LRScheduler:
    if schedule.shape == "constant":
        return torch.optim.lr_scheduler.LambdaLR(optimiser, lambda step: 1.0)
    return torch.optim.lr_scheduler.OneCycleLR(
        optimiser, max_lr=schedule.learning_rate, total_steps=max(2, schedule.steps)
    )


def _generators() -> dict[str, Tensor]:
    states = {"cpu": torch.get_rng_state()}
    if torch.cuda.is_available():
        states["cuda"] = torch.cuda.get_rng_state()
    return states


def _set_generators(states: Mapping[str, Tensor]) -> None:
    torch.set_rng_state(states["cpu"])
    if "cuda" in states and torch.cuda.is_available():
        torch.cuda.set_rng_state(states["cuda"])
