"""Every part of the study: what is trained, and what is measured on it. Parts are independent but for their stage."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Final

import numpy as np
import torch

from benchmarks.common.commands import LOOP, stillwake
from benchmarks.common.markdown import read
from benchmarks.model.study import disturbed
from benchmarks.model.study.lab import Lab, episodes, scaling, student, test_rows, training_rows
from contract import sensors
from contract.arrays import Array
from contract.config.learning import SelectionMethod
from contract.errors import StillwakeError
from train import model_store
from train.distillation.distil import distil, encode_all
from train.distillation.distil_predictor import distil_predictor
from train.distillation.evaluate import evaluate, evaluate_latents, latent_error, rollout_starts
from train.distillation.lessons import teach
from train.fitting.fit import fit_joint, seeded
from train.fitting.streaming import encode_stream, fit_stream
from train.networks.model import Encoder, WakeModel
from train.pipeline import train_all
from train.samples.rows import Rows, prepare
from train.selection.methods import METHODS, select

SEEDS: Final = (0, 1, 2)
COUNTS: Final = (1, 2, 3, 4, 6, 8, 12, 16, 24, 90)
UNROLLS: Final = (3, 5, 10, 25)
UNROLL_EPOCHS: Final = 4.0
"""Of the fit with k = 5, and again of the finish with k, for models that differ in that k alone."""
GROWTH: Final = tuple(range(1, 51))
BANDS: Final = 6
"""Of the chirp's frequencies."""
WIDTHS: Final = ((128, 64), (96, 64))
HARDENED: Final = 0.05
"""The release's `train.sensor_noise`."""
LOOPS: Final = (*METHODS, "full", "hardened", "128_64", "96_64")
"""Variants that close the loop: a method's sensors, the whole distillation of SHAP's, or narrower networks."""


@dataclass(frozen=True, kw_only=True)
class Part:
    """A piece of work for one worker, by name and arguments: `KINDS[kind](lab, *arguments)`."""

    kind: str
    arguments: tuple[Any, ...] = ()

    @property
    def name(self) -> str:
        return "_".join([self.kind, *(str(argument) for argument in self.arguments)])


def stages() -> Iterator[Sequence[Part]]:
    """Parts that may run side by side, stage after stage."""
    yield [Part(kind="model", arguments=(seed,)) for seed in SEEDS]
    yield [
        *(Part(kind="hardened", arguments=(seed,)) for seed in SEEDS),
        *(Part(kind="choice", arguments=(method,)) for method in METHODS),
        *(Part(kind="count", arguments=(count,)) for count in COUNTS),
        *(Part(kind="without", arguments=(place,)) for place in range(4)),
        *(Part(kind="width", arguments=widths) for widths in WIDTHS),
        Part(kind="stream"),
        Part(kind="bands"),
    ]
    yield [
        Part(kind="disturbed"),
        *(Part(kind="method", arguments=(method, seed)) for method in METHODS for seed in SEEDS),
    ]
    yield [Part(kind="loop", arguments=(name,)) for name in LOOPS]
    yield [Part(kind="unroll", arguments=(unroll,)) for unroll in UNROLLS]


def model(lab: Lab, seed: int) -> dict[str, Any]:
    """The whole training with this seed, as `stillwake train` does it."""
    path = lab.model_path(seed)
    if not path.exists():
        train_all(lab.recording, lab.seeded(seed), path, resume=True)
    trained, rows = lab.model(seed), test_rows()
    latents = encode_all(trained.teacher.encoder, training_rows())
    latents = latents[~latents[:, 0].isnan()]
    slim_rows = rows.with_sensors(sensors.TRUCK.indices(trained.sensors))
    return {
        "seed": seed,
        "sensors": list(trained.sensors),
        "metrics": trained.metrics.as_tree(),
        "ranking": trained.ranking.as_tree(),
        "growth": {
            "teacher": evaluate(trained.teacher.encoder, trained.teacher, rows, horizons=GROWTH).as_tree()["rollout"],
            "slim": evaluate(trained.slim, trained.deployed, slim_rows, horizons=GROWTH).as_tree()["rollout"],
        },
        "latent_std": latents.std(dim=0).tolist(),
        "latent_covariance": torch.cov(latents.T).tolist(),
    }


def count(lab: Lab, number: int) -> dict[str, Any]:
    """A student on the ranking's best `number` sensors."""
    return student(lab, lab.model().teacher, lab.model().ranking.order[:number], seed=0)[1]


def without(lab: Lab, place: int) -> dict[str, Any]:
    """A student on the chosen sensors but one (paper, appendix C)."""
    names = lab.model().sensors
    left = names[:place] + names[place + 1 :]
    return {"removed": names[place], **student(lab, lab.model().teacher, left, seed=0)[1]}


def choice(lab: Lab, method: SelectionMethod) -> dict[str, Any]:
    """What a method of selection picks, and how long it takes."""
    began = time.process_time()
    trained = lab.model()
    if method == "shap":
        return {"method": method, "sensors": list(trained.sensors), "cpu_seconds": None}
    settings = lab.config.train
    names = select(method, trained.teacher.encoder, training_rows(), settings.sensors, settings=settings)
    return {"method": method, "sensors": list(names), "cpu_seconds": time.process_time() - began}


def method(lab: Lab, name: SelectionMethod, seed: int) -> dict[str, Any]:
    """A student on that method's choice; the first seed's is kept for the loop."""
    names = tuple(lab.part(f"choice_{name}", lambda: choice(lab, name))["sensors"])
    slim, found = student(lab, lab.model().teacher, names, seed)
    if seed == SEEDS[0]:
        model_store.save(lab.variant(name), replace(lab.model(), slim=slim, sensors=names))
    return {"method": name, **found}


def hardened(lab: Lab, seed: int) -> dict[str, Any]:
    """The release's way: sensors chosen, and the encoder distilled, under noise of `HARDENED` global deviations."""
    trained = lab.model(seed)
    settings = replace(lab.config.train, selection="greedy", sensor_noise=HARDENED, seed=seed)
    names = select("greedy", trained.teacher.encoder, training_rows(), settings.sensors, settings=settings)
    chosen = sensors.TRUCK.indices(names)
    slim = distil(trained.teacher.encoder, training_rows(), chosen, replace(lab.config, train=settings))
    if seed == SEEDS[0]:
        model_store.save(lab.variant("hardened"), replace(trained, slim=slim, sensors=names))
    return {"sensors": list(names), **evaluate(slim, trained.teacher, test_rows().with_sensors(chosen)).as_tree()}


def bands(lab: Lab) -> dict[str, Any]:
    """Roll-outs of 25 steps by the forcing's frequency, and on the training waveform itself, with all 90 sensors."""
    teacher = lab.model().teacher
    forcing, rows = lab.config.forcing, test_rows()
    error, ends = _rolled(teacher, rows)
    frequency = forcing.chirp_start + (forcing.chirp_end - forcing.chirp_start) * ends / len(rows.inputs)
    edges = np.linspace(forcing.chirp_start, forcing.chirp_end, BANDS + 1)
    waveform = prepare(episodes("train")[:2], scaling(), mirrored=False)
    return {
        "bands": [
            {"from": low, "to": high, "error": error[(frequency >= low) & (frequency < high)].mean(axis=0).tolist()}
            for low, high in pairwise(edges.tolist())
        ],
        "training": _rolled(teacher, waveform)[0].mean(axis=0).tolist(),
    }


def _rolled(teacher: WakeModel, rows: Rows) -> tuple[Array, Array]:
    """Errors of forces 25 steps ahead over their deviation, (m, 2), and the row they are judged at, (m,)."""
    ahead = 25
    latents = encode_all(teacher.encoder, rows)
    starts = rollout_starts(rows, teacher.encoder.window, ahead)
    with torch.no_grad():
        rolled = teacher.dynamics.rollout(latents[starts], rows.actions[starts[:, None] + torch.arange(ahead)])
        error = (teacher.decoder(rolled[-1]) - rows.forces[starts + ahead]).abs() / rows.forces.std(dim=0)
    return error.numpy().astype(np.float64), (starts + ahead).numpy().astype(np.float64)


def unroll(lab: Lab, steps: int) -> dict[str, Any]:
    """A teacher fitted with k = 5 and finished with another unroll: how its roll-outs err, and what it cost."""
    began = time.process_time()
    finish = replace(lab.config.train.finish, unroll=steps, epochs=UNROLL_EPOCHS)
    settings = replace(lab.config.train, epochs=UNROLL_EPOCHS, finish=finish)
    trained = fit_joint(training_rows(), replace(lab.config, train=settings))
    cpu = (time.process_time() - began) / 60.0
    return {"unroll": steps, "cpu_minutes": cpu, **_grown(trained.encoder, trained)}


def width(lab: Lab, dynamics: int, decoder: int) -> dict[str, Any]:
    """Narrower dynamics and decoder behind the slim encoder."""
    began = time.process_time()
    trained = lab.model()
    slimmed = replace(lab.config.model, slim_dynamics_width=dynamics, slim_decoder_width=decoder)
    chosen = sensors.TRUCK.indices(trained.sensors)
    latents = encode_all(trained.slim, training_rows().with_sensors(chosen))
    lessons = teach(trained.teacher, latents, training_rows(), trained.scaling, lab.config)
    student_networks = distil_predictor(lessons, slimmed, lab.config.train)
    rows = test_rows().with_sensors(chosen)
    found = evaluate(trained.slim, student_networks, rows).as_tree()
    narrow = replace(trained, config=replace(trained.config, model=slimmed), predictor=student_networks)
    model_store.save(lab.variant(f"{dynamics}_{decoder}"), narrow)
    parameters = sum(item.numel() for item in student_networks.parameters())
    return {
        "dynamics": dynamics,
        "decoder": decoder,
        "parameters": parameters,
        "cpu_minutes": (time.process_time() - began) / 60.0,
        **found,
    }


def stream(lab: Lab) -> dict[str, Any]:
    """A student that carries its state on, beside the released one that reads windows."""
    began = time.process_time()
    trained, config = lab.model(), lab.config
    chosen = sensors.TRUCK.indices(trained.sensors)
    rows, test = training_rows().with_sensors(chosen), test_rows().with_sensors(chosen)
    target = encode_all(trained.teacher.encoder, training_rows())
    with seeded(config.train.seed, torch.device("cpu")):
        carried = Encoder(len(chosen), config.model)
        fit_stream(carried, target, rows, config)
    cpu = (time.process_time() - began) / 60.0
    teacher_latents = encode_all(trained.teacher.encoder, test_rows())
    window = config.model.window
    latents = {
        "streamed": encode_stream(carried, test),
        "read as windows": encode_all(carried, test),
        "finished on windows": encode_all(trained.slim, test),
    }
    return {
        "cpu_minutes": cpu,
        "rows": [
            {
                "case": case,
                "latent": latent_error(values, teacher_latents),
                **evaluate_latents(values, trained.teacher, test, window=window).as_tree(),
            }
            for case, values in latents.items()
        ],
    }


def loop(lab: Lab, name: str) -> dict[str, Any]:
    """The closed loop with a variant of the first seed's model, as `stillwake export` and `stillwake run` make it."""
    bundle, run = (lab.folder / f"{kind}_{name}" for kind in ("bundle", "run"))
    if not bundle.exists():
        # The export's gate on the cost gap refuses the narrow networks with int8 weights.
        precision = "int8" if name in (*METHODS, "full", "hardened") else "float32"
        model = lab.model_path(SEEDS[0]) if name == "full" else lab.variant(name)
        try:
            stillwake("export", model, bundle, "--dataset", lab.recording, "--precision", precision)
        except StillwakeError:
            return {"variant": name, "refused": True}
    stillwake("run", run, "--overwrite", "--bundle", bundle, "--json", run.with_suffix(".json"))
    figures = read(run.with_suffix(".json"))["figures"]
    return {"variant": name, **{key: figures[key] for key in LOOP}}


def _grown(encoder: Encoder, trained: WakeModel) -> dict[str, Any]:
    return evaluate(encoder, trained, test_rows(), horizons=GROWTH).as_tree()


KINDS: Final[Mapping[str, Callable[..., Any]]] = {
    "model": model,
    "count": count,
    "without": without,
    "choice": choice,
    "method": method,
    "unroll": unroll,
    "width": width,
    "hardened": hardened,
    "bands": bands,
    "loop": loop,
    "stream": stream,
    "disturbed": lambda lab: disturbed.measure(lab, scaling()),
}


def run(lab: Lab, part: Part) -> Any:
    """One part, made now if it is not there."""
    return lab.part(part.name, lambda: KINDS[part.kind](lab, *part.arguments))
