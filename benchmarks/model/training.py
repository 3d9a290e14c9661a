"""One training step, ours and the straightforward one, and the arithmetic below which neither can go.

    python -m benchmarks training [--json FILE] [--threads 1]

Straightforward: every sample brings its k + 1 windows, `torch.nn.LSTM` reads each from its first row, autograd walks
back. Ours: neighbouring samples are drawn together, so that windows are shared, rows are projected once, and the
recurrence has its own backward pass (`train.networks.recurrence`). Batch, networks and loss are the same; the losses
agree.
The floor is the multiply-accumulates of our step at the speed of one large matrix product on the same thread.
"""

import time
from collections.abc import Callable
from dataclasses import replace
from statistics import median
from typing import Annotated, Any, Final

import torch
import typer
from rich.table import Table
from torch import Tensor, nn

from benchmarks.common.command_line import JsonFile, console, save, track
from contract.config.loading import training as training_settings
from contract.config.tree import Config
from contract.recording import dataset
from contract.results import versions
from contract.shipped import RECORDING
from train.fitting.streaming import STRETCH
from train.networks.loss import joint_loss
from train.networks.model import Encoder, WakeModel
from train.samples.rows import Rows, prepare
from train.samples.sampler import SegmentSampler
from train.samples.scaling import fit_scaling

GEMM: Final = 1024
"""Size of the square product that sets the floor's speed."""


def main(
    json_file: JsonFile = None,
    threads: Annotated[int, typer.Option(help="Of torch.", min=1)] = 1,
    repeats: Annotated[int, typer.Option(help="Interleaved repeats.", min=3)] = 9,
) -> None:
    """Time the steps in turn, print medians."""
    torch.set_num_threads(threads)
    config = training_settings()
    episodes = dataset.read(RECORDING).with_role("train")[:2]
    rows = prepare(episodes, fit_scaling(episodes), mirrored=False)
    alone = replace(config, train=replace(config.train, segment=1))
    model = WakeModel(90, config.model)
    calls = {
        "straightforward": _step(model, rows, alone, _plain),
        "shared": _step(model, rows, config, Encoder.encode_segments),
        "shared_lstm": _lstm_alone(model, rows, config),
        "stream_lstm": _stream(model, rows, config),
        "gemm": _gemm(),
    }
    for call in calls.values():
        call()
    taken: dict[str, list[float]] = {name: [] for name in calls}
    for _ in track(range(repeats), "repeats", "repeats"):
        for name, call in calls.items():
            began = time.perf_counter()
            call()
            taken[name].append(1e3 * (time.perf_counter() - began))
    ms = {name: median(times) for name, times in taken.items()}
    figures = _figures(ms, config)
    table = Table("training step", "", title=f"batch {config.train.batch_size}, {threads} thread(s)")
    for name, value in figures.items():
        table.add_row(name, f"{value:.4g}")
    console.print(table)
    facts = {"threads": threads, "repeats": repeats, "versions": versions("stillwake", "torch")}
    save(json_file, figures=figures, facts=facts)


def _figures(ms: dict[str, float], config: Config) -> dict[str, float]:
    batch = config.train.batch_size
    flops_per_ms = 2.0 * GEMM**3 / ms["gemm"]
    mac = _multiply_accumulates(config)
    return {
        "straightforward_ms": ms["straightforward"],
        "shared_ms": ms["shared"],
        "times_faster": ms["straightforward"] / ms["shared"],
        "samples_per_s": 1e3 * batch / ms["shared"],
        "lstm_ms": ms["shared_lstm"],
        "lstm_share": ms["shared_lstm"] / ms["shared"],
        "lstm_floor_ms": 6.0 * mac["lstm"] / flops_per_ms,
        "step_floor_ms": 6.0 * (mac["lstm"] + mac["heads"]) / flops_per_ms,
        "stream_lstm_ms": ms["stream_lstm"],
        "gemm_gflops": flops_per_ms / 1e6,
    }


def _multiply_accumulates(config: Config) -> dict[str, float]:
    """The arithmetic of one forward pass over a batch; the backward pass has twice as many."""
    shape, settings = config.model, config.train
    segments = settings.batch_size // settings.segment
    windows = segments * (settings.segment + settings.unroll)
    rows = windows + segments * (shape.window - 1)
    h, z, w, d = shape.lstm_width, shape.latent, shape.dynamics_width, shape.decoder_width
    dynamics = (z + 1) * w + w * w + w * z
    decoder = z * d + shape.decoder_blocks * d * d + 2 * d
    return {
        "lstm": rows * 91 * 4 * h + windows * shape.window * 4 * h * h,
        "heads": windows * (h * h + h * z) + settings.batch_size * settings.unroll * (dynamics + decoder),
    }


def _step(
    model: WakeModel, rows: Rows, config: Config, encode: Callable[[Encoder, Tensor], Tensor]
) -> Callable[[], None]:
    sampler = _sampler(rows, config, config.train.unroll, config.train.segment, config.train.batch_size)
    encoder = _Encoding(model.encoder, encode)
    pretended: Any = _Model(encoder, model.dynamics, model.decoder)
    optimiser = torch.optim.Adam(model.parameters(), lr=0.0)

    def step() -> None:
        optimiser.zero_grad()
        torch.autograd.backward(joint_loss(pretended, sampler.batch(0), config.train).total)
        optimiser.step()

    return step


class _Encoding(nn.Module):
    """An encoder read in another way."""

    def __init__(self, encoder: Encoder, encode: Callable[[Encoder, Tensor], Tensor]) -> None:
        super().__init__()
        self.encoder, self.encode = encoder, encode

    def encode_segments(self, segments: Tensor) -> Tensor:
        return self.encode(self.encoder, segments)


class _Model(nn.Module):
    def __init__(self, encoder: _Encoding, dynamics: nn.Module, decoder: nn.Module) -> None:
        super().__init__()
        self.encoder, self.dynamics, self.decoder = encoder, dynamics, decoder


def _plain(encoder: Encoder, segments: Tensor) -> Tensor:
    windows = segments.unfold(1, encoder.window, 1).transpose(2, 3)
    states, _ = encoder.lstm(windows.flatten(0, 1))
    return encoder.read_out(states[:, -1].unflatten(0, windows.shape[:2]))


def _lstm_alone(model: WakeModel, rows: Rows, config: Config) -> Callable[[], None]:
    sampler = _sampler(rows, config, config.train.unroll, config.train.segment, config.train.batch_size)
    return lambda: torch.autograd.backward(model.encoder.encode_segments(sampler.batch(0).inputs).sum())


def _stream(model: WakeModel, rows: Rows, config: Config) -> Callable[[], None]:
    """As many latents as a batch has, read as a stream."""
    sampler = _sampler(rows, config, 0, STRETCH, config.train.batch_size)

    def step() -> None:
        hidden, _ = model.encoder.lstm(sampler.batch(0).inputs)
        torch.autograd.backward(model.encoder.read_out(hidden[:, config.model.window - 1 :]).sum())

    return step


def _gemm() -> Callable[[], None]:
    a, b = torch.randn(GEMM, GEMM), torch.randn(GEMM, GEMM)
    out = torch.empty(GEMM, GEMM)

    def product() -> None:
        torch.mm(a, b, out=out)

    return product


def _sampler(rows: Rows, config: Config, ahead: int, segment: int, batch_size: int) -> SegmentSampler:
    return SegmentSampler(
        rows, window=config.model.window, ahead=ahead, segment=segment, batch_size=batch_size, seed=config.train.seed
    )
