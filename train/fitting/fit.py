"""The training loop, and the joint fit of encoder, dynamics and decoder (paper, section 2.2.4).

A run depends on configuration and recording only. Batches depend only on the seed and the step. Initial weights and
dropout depend on a generator that this module seeds and the checkpoint stores. So a run that is interrupted and resumed
ends with the weights of an uninterrupted run, if machine and number of threads are the same.

The default number of torch's threads is one: on a machine with other work, a step with two threads used ten times the
CPU time (measured). The number of threads changes the order of sums, and so the bytes of a trained model.
"""

import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, replace

import torch
from torch import Tensor, nn

from contract.config.learning import TrainConfig
from contract.config.tree import Config
from contract.errors import ConfigError, TrainingError
from train.fitting.progress import Phase, Progress, silent
from train.fitting.unfinished import Checkpoints, Reached
from train.networks.model import WakeModel, joint_loss
from train.networks.samples import Rows, SegmentSampler


@contextmanager
def torch_threads(count: int) -> Iterator[None]:
    """Set torch's number of threads inside the block, then restore it; raises ConfigError for a number below 1."""
    if count < 1:
        raise ConfigError(f"threads = {count}: must be at least 1")
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


@contextmanager
def without_denormals() -> Iterator[None]:
    """Flush denormal numbers to zero inside the block, in this thread. A flow in single precision and its adjoint have
    many such tiny numbers in regions where waves have decayed. Some processors take a hundred times as long for an
    operation with a denormal number. A gradient then took three times as long (measured once, Xeon of 2.5 GHz)."""
    torch.set_flush_denormal(True)
    try:
        yield
    finally:
        torch.set_flush_denormal(False)  # torch cannot report the previous setting; no other code switches it on


REPORT_EVERY = 10
"""Number of steps between progress reports. A report has to wait until the device has computed the loss."""


def device_named(name: str) -> torch.device:
    """Return the device "cpu" or "cuda". Raises ConfigError for another name, or if CUDA is absent."""
    if name not in ("cpu", "cuda"):
        raise ConfigError(f"device {name!r}: must be 'cpu' or 'cuda'")
    if name == "cuda" and not torch.cuda.is_available():
        raise ConfigError("device 'cuda': this machine or this build of torch has no CUDA")
    return torch.device(name)


@contextmanager
def seeded(seed: int, device: torch.device) -> Iterator[None]:
    """Seed torch's random numbers inside the block, and restore the caller's generators at the end."""
    with torch.random.fork_rng(devices=[device] if device.type == "cuda" else []):
        torch.manual_seed(seed)
        yield


def optimise(
    module: nn.Module,
    loss: Callable[[int], Mapping[str, Tensor]],
    steps: int,
    settings: TrainConfig,
    *,
    phase: Phase,
    progress: Progress = silent,
    checkpoints: Checkpoints | None = None,
) -> None:
    """Minimise `loss(step)["total"]` over the module's parameters in place, with `steps` steps of Adam. The learning
    rate is constant or has one cycle (warm-up, then cosine to zero; Smith 2017). Call this function inside `seeded`:
    the generator's state is saved and restored with the checkpoint. Raises the errors of `Checkpoints`. Removes the
    checkpoints and raises TrainingError if the loss or, at a checkpoint, a weight is not finite."""
    optimiser = torch.optim.Adam(module.parameters(), lr=settings.learning_rate)
    rate = _rate(optimiser, steps, settings)
    first = 0
    state = None if checkpoints is None else checkpoints.load(phase)
    if state is not None:
        module.load_state_dict(state["module"])
        optimiser.load_state_dict(state["optimiser"])
        rate.load_state_dict(state["rate"])
        torch.set_rng_state(state["generators"]["cpu"])
        if "cuda" in state["generators"] and torch.cuda.is_available():
            torch.cuda.set_rng_state(state["generators"]["cuda"])
        first = state["step"]

    def check_finite(value: Tensor, after: int) -> None:
        if torch.isfinite(value).all():
            return
        if checkpoints is not None:
            # A run that continues from these checkpoints with unchanged settings would fail again.
            shutil.rmtree(checkpoints.folder, ignore_errors=True)
        raise TrainingError(
            f"{phase.label}: the loss is not finite after {after} of {steps} iterations with train.learning_rate = "
            f"{settings.learning_rate:g}: choose a lower learning rate; the paper uses 0.001"
        )

    module.train()
    for step in range(first, steps):
        terms = loss(step)
        done = step + 1
        is_kept = checkpoints is not None and (done % checkpoints.every == 0 or done == steps)
        # The loss is read rarely on a GPU, because each reading waits until the GPU has finished its work.
        if terms["total"].device.type == "cpu" or done % REPORT_EVERY == 0 or is_kept:
            check_finite(terms["total"], step)
        optimiser.zero_grad()
        torch.autograd.backward(terms["total"])
        optimiser.step()
        rate.step()
        if done % REPORT_EVERY == 0 or done == steps:
            progress(phase, done, steps, {name: value.item() for name, value in terms.items()})
        if checkpoints is not None and is_kept:
            for parameter in module.parameters():
                check_finite(parameter, done)
            learned = {"module": module.state_dict(), "optimiser": optimiser.state_dict(), "rate": rate.state_dict()}
            cuda = {"cuda": torch.cuda.get_rng_state()} if torch.cuda.is_available() else {}
            state = {**learned, "generators": {"cpu": torch.get_rng_state(), **cuda}, "step": done}
            checkpoints.save(phase, state, Reached(phase=phase, step=done, total=steps))
    module.eval()


def fit_joint(
    rows: Rows, config: Config, *, progress: Progress = silent, checkpoints: Checkpoints | None = None
) -> WakeModel:
    """Train encoder, dynamics and decoder together on standardised rows. The result is on the rows' device, in
    evaluation mode. Raises DatasetError if an episode is too short for window, unroll and segment."""
    settings, device = config.train, rows.inputs.device
    with seeded(settings.seed, device):
        model = WakeModel(rows.inputs.shape[1] - 1, config.model).to(device)

        def fit(settings: TrainConfig, phase: Phase) -> None:
            sampler = SegmentSampler(
                rows,
                window=config.model.window,
                ahead=settings.unroll,
                segment=settings.segment,
                batch_size=settings.batch_size,
                seed=settings.seed,
            )
            steps = sampler.steps(settings.epochs)

            def loss(step: int) -> dict[str, Tensor]:
                return joint_loss(model, sampler.batch(step), settings)

            optimise(model, loss, steps, settings, phase=phase, progress=progress, checkpoints=checkpoints)

        fit(settings, Phase.FIT)
        if settings.finish.epochs:
            # Each field of `finish` replaces the setting of its name. This part reads windows, as the vehicle does.
            fit(replace(settings, streamed=False, **asdict(settings.finish)), Phase.FINISH)
    return model


def _rate(optimiser: torch.optim.Optimizer, steps: int, settings: TrainConfig) -> torch.optim.lr_scheduler.LRScheduler:
    if settings.schedule == "constant":
        return torch.optim.lr_scheduler.LambdaLR(optimiser, lambda step: 1.0)
    return torch.optim.lr_scheduler.OneCycleLR(optimiser, max_lr=settings.learning_rate, total_steps=max(2, steps))
