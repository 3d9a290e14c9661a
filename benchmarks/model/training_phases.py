"""CPU minutes of each phase of a training: the release's recipe and the quicker one, on one thread.

    python -m benchmarks training-phases [--json FILE] [--steps 20]

Some steps of every phase run on the shipped recording and its mirror image, and their CPU time is multiplied by the
steps that the phase has. CPU time is the process's: on an idle core it is the time on the wall, and beside other work
it grows less than that. Choosing sensors is left out, as it is where they are given.
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Annotated, Any, Final

import typer
from rich.table import Table

from benchmarks.common.command_line import JsonFile, console, save, track
from contract.config.loading import load_config, quick
from contract.config.tree import Config
from contract.recording import dataset
from contract.recording.findings import trainable
from contract.results import versions
from train.distil import distil, encode_all
from train.distil_predictor import distil_predictor
from train.fit import fit_joint
from train.lessons import teach
from train.model import WakeModel
from train.progress import Phase, Progress
from train.rows import Rows, prepare
from train.scaling import fit_scaling
from train.threads import torch_threads
from wake.shipped import RECORDING

SENSORS: Final = ("lower_36", "base_7", "upper_39", "base_0")
"""Of the release."""
_FEW: Final = 4096
"""Lessons made for the measurement; the phase's number of steps is of the recipe's."""


class _EnoughError(Exception):
    """The phase has been measured."""


def main(
    json_file: JsonFile = None,
    steps: Annotated[int, typer.Option(help="Of every phase.", min=10)] = 20,
) -> None:
    """Measure both recipes, print a table."""
    recipes = {"release": load_config(), "quick": quick()}
    with torch_threads(1):
        found = {name: _recipe(name, config, steps) for name, config in recipes.items()}
    table = Table("phase", *(f"{name}, {what}" for name in recipes for what in ("steps", "ms a step", "CPU min")))
    for rows in zip(*found.values(), strict=True):
        cells = [cell for row in rows for cell in (str(row["steps"]), f"{row['ms']:.0f}", f"{row['cpu_min']:.1f}")]
        table.add_row(rows[0]["phase"], *cells)
    console.print(table)
    facts = {"threads": 1, "measured_steps": steps, "versions": versions("stillwake", "torch")}
    save(json_file, figures=found, facts=facts)


def _recipe(name: str, config: Config, steps: int) -> list[dict[str, Any]]:
    recording = dataset.read(RECORDING)
    episodes = trainable(recording, config)
    scaling = fit_scaling(episodes, recording.layout)
    rows = prepare(episodes, scaling, mirrored=True, layout=recording.layout)
    settings = config.train
    teacher = WakeModel(rows.sensors, config.model).eval()
    latents = encode_all(teacher.encoder, rows)
    chosen = recording.layout.indices(SENSORS)
    few = _with(config, predictor_lessons=_FEW)
    lessons = teach(teacher, latents, rows, scaling, few)
    # So many passes over few lessons are as many steps as the recipe's over all.
    passes = settings.predictor_epochs * settings.predictor_lessons / len(lessons)
    none = replace(settings.finish, epochs=0.0)
    calls: dict[Phase, Callable[[Progress], object]] = {
        Phase.FIT: lambda watch: fit_joint(rows, _with(config, finish=none), progress=watch),
        Phase.FINISH: lambda watch: _finish(rows, config, watch),
        Phase.STREAM: lambda watch: distil(teacher.encoder, rows, chosen, config, progress=watch),
        Phase.DISTIL: lambda watch: distil(
            teacher.encoder, rows, chosen, _with(config, stream_epochs=0.0), progress=watch
        ),
        Phase.LESSONS: lambda watch: teach(teacher, latents, rows, scaling, config, progress=watch),
        Phase.PREDICTOR: lambda watch: distil_predictor(
            lessons, config.model, replace(settings, predictor_epochs=passes), progress=watch
        ),
    }
    return [_measured(phase, calls[phase], steps) for phase in track(list(calls), name, "phases")]


def _with(config: Config, **changes: Any) -> Config:
    return replace(config, train=replace(config.train, **changes))


def _finish(rows: Rows, config: Config, watch: Progress) -> None:
    """The finish alone: a joint fit with its settings."""
    last, none = config.train.finish, replace(config.train.finish, epochs=0.0)
    alone = _with(
        config, streamed=False, finish=none, epochs=last.epochs, unroll=last.unroll, decode_weight=last.decode_weight
    )
    fit_joint(rows, alone, progress=watch)


def _measured(which: Phase, call: Callable[[Progress], object], steps: int) -> dict[str, Any]:
    """From the phase's first report on, which comes after some steps that warm up."""
    began: list[tuple[int, float]] = []
    found: dict[str, Any] = {}

    def watch(phase: Phase, step: int, total: int, terms: Mapping[str, float]) -> None:
        now = time.process_time()
        if not began:
            began.append((step, now))
            return
        first, at = began[0]
        if step - first >= steps or step == total:
            ms = 1e3 * (now - at) / (step - first)
            found.update(phase=which.label, steps=total, ms=ms, cpu_min=ms * total / 6e4)
            raise _EnoughError

    try:
        call(watch)
    except _EnoughError:
        return found
    raise AssertionError(f"{which}: ended before {steps} steps")
