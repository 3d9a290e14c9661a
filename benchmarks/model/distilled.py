"""What a narrow predictor is taught, and what its controller reaches in the loop: widths, with and without slopes.

    python -m benchmarks distilled [--model DIR] [--json FILE]

The teacher and the encoder of one model, and narrow dynamics and decoder distilled from them anew: each becomes an int8
bundle and closes the loop through CAN from several phases of the shedding cycle. Finished parts are kept.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import date
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Final

import torch
import typer
from rich.table import Table

from benchmarks.common.command_line import MODEL, Dataset, JsonFile, Model, Parts, console, save, track
from benchmarks.common.commands import LOOP
from benchmarks.common.parts import part
from contract.config.controller import MpcConfig
from contract.config.loading import load_config
from contract.config.tree import Config
from contract.model import model_folder
from contract.recording import dataset
from contract.recording.findings import trainable
from contract.release import bundle as bundles
from contract.results import versions
from contract.shipped import RECORDING
from export.release.pipeline import export_all
from firmware_sim.bench.simulation import simulate
from firmware_sim.bench.spans import Spans
from firmware_sim.campaign.folder import CampaignFolder
from firmware_sim.campaign.starts import keep_states, starting_states
from firmware_sim.runs.summary import summary
from train import model_store
from train.distillation.distil import encode_all
from train.distillation.distil_predictor import distil_predictor
from train.distillation.lessons import Lessons, teach
from train.model_store import TrainedModel
from train.samples.rows import prepare
from wake.truck.state import State
from wake.truck.truck_wake import TruckWake


@dataclass(frozen=True, kw_only=True)
class Variant:
    """A predictor to be judged.

    Attributes:
        name: of its row and its parts.
        widths: of dynamics and decoder; None takes the teacher's own.
        slope_weight: `train.slope_weight`.
        iterations, learning_rate: of the optimiser, in place of the model's.
    """

    name: str
    widths: tuple[int, int] | None
    slope_weight: float = 0.3
    iterations: int | None = None
    learning_rate: float | None = None


VARIANTS: Final = (
    Variant(name="wide_5", widths=None, iterations=5, learning_rate=1e-3),
    Variant(name="wide", widths=None),
    Variant(name="96_64", widths=(96, 64)),
    Variant(name="96_64_no_slope", widths=(96, 64), slope_weight=0.0),
    Variant(name="96_48", widths=(96, 48)),
    Variant(name="64_32", widths=(64, 32)),
)
_SPANS: Final = Spans(lead_in=10.0, controlled=100.0, settle=40.0)


def main(
    model: Model = MODEL,
    data: Dataset = RECORDING,
    json_file: JsonFile = None,
    parts: Parts = Path("runs/distilled"),
    phases: Annotated[int, typer.Option(min=1, help="Phases of the shedding cycle that the loop is closed from.")] = 3,
) -> None:
    """Distil, close the loops and print a table."""
    torch.set_num_threads(1)
    trained = model_store.load(model)
    folder = parts / model_weights(model)[:12]
    folder.mkdir(parents=True, exist_ok=True)
    starts = _starts(folder, phases)
    rows = []
    for variant in track(VARIANTS, "variants", "variants"):
        bundle = folder / variant.name
        if not bundle.exists():
            _make(variant, trained, folder, data)
        loops = [
            part(folder / f"{variant.name}_phase_{number}.json", partial(_loop, bundle, start))
            for number, start in enumerate(starts)
        ]
        rows.append(_row(variant, bundle, loops))
    _print(rows)
    facts = {
        "phases": phases,
        "controlled": _SPANS.controlled,
        "settle": _SPANS.settle,
        "sensors": trained.sensors,
        "weights_sha256": model_weights(model),
        "lessons": trained.config.train.predictor_lessons,
        "versions": versions("stillwake", "torch", "onnxruntime", "numpy"),
    }
    save(json_file, figures=rows, facts=facts)


def model_weights(model: Path) -> str:
    """The hash of a model's weights, by which its parts are named."""
    return str(model_folder.read(model).weights_sha256)


def _make(variant: Variant, trained: TrainedModel, folder: Path, data: Path) -> None:
    """Distil the variant from the model's teacher, store it as a model and export it."""
    config = _config(variant, trained.config)
    predictor = None
    if variant.widths is not None:
        predictor = distil_predictor(_lessons(trained, folder, data), config.model, config.train)
    model_store.save(folder / f"{variant.name}_model", replace(trained, config=config, predictor=predictor))
    export_all(
        folder / f"{variant.name}_model",
        folder / variant.name,
        precision="int8",
        name=variant.name,
        recording=data,
        config=config,
        c_folder=None,
        created=date.today(),
    )


def _config(variant: Variant, config: Config) -> Config:
    dynamics, decoder = (None, None) if variant.widths is None else variant.widths
    mpc: MpcConfig = replace(
        config.mpc,
        iterations=variant.iterations or config.mpc.iterations,
        learning_rate=variant.learning_rate or config.mpc.learning_rate,
    )
    return replace(
        config,
        model=replace(config.model, slim_dynamics_width=dynamics, slim_decoder_width=decoder),
        train=replace(config.train, slope_weight=variant.slope_weight),
        mpc=mpc,
    )


def _lessons(trained: TrainedModel, folder: Path, data: Path) -> Lessons:
    path = folder / "lessons.pt"
    if not path.exists():
        recording = dataset.read(data)
        rows = prepare(
            trainable(recording, trained.config), trained.scaling, mirrored=trained.layout.mirror is not None
        )
        latents = encode_all(trained.slim, rows.with_sensors(trained.layout.indices(trained.sensors)))
        torch.save(vars(teach(trained.teacher, latents, rows, trained.scaling, trained.config)), path)
    return Lessons(**torch.load(path, weights_only=True))


def _starts(folder: Path, phases: int) -> Sequence[State]:
    kept = CampaignFolder(folder)
    kept.start(0).parent.mkdir(parents=True, exist_ok=True)
    states = starting_states(kept, load_config(), phases)
    keep_states(kept, states)
    return states


def _loop(bundle: Path, start: State) -> dict[str, Any]:
    """What `summary` finds of a run from there."""
    config, release = load_config(), bundles.load(bundle)
    wake = TruckWake(config.flow, body=config.body)
    wake.reset(start)
    log = simulate(release, replace(config, mpc=release.manifest.mpc), spans=_SPANS, wake=wake)
    found = summary(log)
    return {name: found[name] for name in (*LOOP, "Cd_uncontrolled")}


def _row(variant: Variant, bundle: Path, loops: Sequence[Mapping[str, float]]) -> dict[str, Any]:
    mpc = bundles.load(bundle).manifest.mpc
    mean = {name: sum(loop[name] for loop in loops) / len(loops) for name in LOOP}
    reached = [loop["reduction_percent"] for loop in loops]
    return {
        "name": variant.name,
        "widths": variant.widths,
        "slope_weight": variant.slope_weight if variant.widths else None,
        "iterations": mpc.iterations,
        "learning_rate": mpc.learning_rate,
        **mean,
        "least_reduction_percent": min(reached),
        "most_reduction_percent": max(reached),
    }


def _print(rows: list[dict[str, Any]]) -> None:
    table = Table("dynamics/decoder", "slopes", "iterations", "less drag, %", "from .. to", "mean |Cl|", "rms action")
    for row in rows:
        table.add_row(
            "as trained" if row["widths"] is None else "{}/{}".format(*row["widths"]),
            {None: "", 0.0: "no"}.get(row["slope_weight"], "yes"),
            f"{row['iterations']} x {row['learning_rate']:g}",
            f"{row['reduction_percent']:.2f}",
            f"{row['least_reduction_percent']:.2f} .. {row['most_reduction_percent']:.2f}",
            f"{row['abs_Cl_controlled']:.3f}",
            f"{row['rms_action']:.4f}",
        )
    console.print(table)
