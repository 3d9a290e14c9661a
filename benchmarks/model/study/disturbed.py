"""How slim encoders err off their training data: other frequencies, disturbed sensors, a larger amplitude."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final

import numpy as np
import torch

from benchmarks.model.study.lab import Lab, episodes, test_rows
from benchmarks.model.study.sliding_error import sliding_error
from contract import sensors
from contract.recording import dataset
from contract.release.manifest import Scaling
from contract.sensor_faults import Bias, Dead, Drift, Noise, SensorFault
from train.distillation.distil import encode_all
from train.distillation.evaluate import evaluate
from train.model_store import load
from train.networks.model import Encoder, WakeModel
from train.samples.rows import Rows, prepare
from train.samples.scaling import unit_steps
from wake.recording.episode_plan import EpisodePlan
from wake.recording.recorder import record

NOISE: Final = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
"""Global deviations (paper, appendix B)."""
OFFSETS: Final = (0.25, 0.5, 1.0)
"""Of a biased or drifting sensor, in global deviations."""
SLIDE: Final = 400
"""Samples of the sliding error (paper, appendix A)."""
THIN: Final = 25
"""Every so many of its values are kept."""
LIMIT: Final = 0.1
"""Of a chirp past the training amplitude of 0.075, U_inf W."""
STEPS: Final = 2000

StartFault = Callable[[int], SensorFault]
"""The fault of an episode of that many steps."""


def measure(lab: Lab, scaling: Scaling) -> dict[str, Any]:
    """All of it for the model of the first seed, with the paper's choice of sensors and with the release's."""
    trained, hardened = lab.model(), load(lab.variant("hardened"))
    teacher = trained.teacher
    encoders = {"shap": (trained.slim, trained.sensors), "hardened": (hardened.slim, hardened.sensors)}
    chosen = {name: sensors.TRUCK.indices(names) for name, (_, names) in encoders.items()}
    extended = {
        name: _slid(slim, teacher, test_rows("extended").with_sensors(chosen[name]))
        for name, (slim, _) in encoders.items()
    }
    return {
        "extended": {
            "frequency": _frequencies().tolist(),
            "teacher": _slid(teacher.encoder, teacher, test_rows("extended")),
            **extended,
        },
        **{name: _faults(slim, names, teacher, scaling) for name, (slim, names) in encoders.items()},
        "amplitude": _amplified(lab, hardened.slim, teacher, scaling, chosen["hardened"]),
    }


def _faults(slim: Encoder, names: tuple[str, ...], teacher: WakeModel, scaling: Scaling) -> dict[str, Any]:
    chosen = sensors.TRUCK.indices(names)
    unit, rows = unit_steps(scaling, chosen), test_rows().with_sensors(chosen)

    def evaluated(start: StartFault) -> dict[str, Any]:
        found = evaluate(slim, teacher, _disturbed(rows, start)).as_tree()
        return {"drag": found["drag"], "lift": found["lift"]}

    def noise(level: float) -> StartFault:
        through_all = Noise(level, unit, seed=1)
        return lambda steps: through_all

    def dead(place: int) -> StartFault:
        return lambda steps: Dead(place)

    def bias(level: float, place: int) -> StartFault:
        return lambda steps: Bias(level, unit, place)

    def drift(level: float, place: int) -> StartFault:
        return lambda steps: Drift(level, unit, place, steps=steps)

    def one(name: str, place: int) -> dict[str, Any]:
        return {"sensor": names[place], "fault": name}

    places = range(len(names))
    single = [{**one("dead", place), "level": None, **evaluated(dead(place))} for place in places]
    single += [
        {**one(name, place), "level": level, **evaluated(make(level, place))}
        for name, make in (("bias", bias), ("drift", drift))
        for level in OFFSETS
        for place in places
    ]
    return {
        "sensors": list(names),
        "own_deviation": (1.0 / unit).tolist(),
        "noise": [{"level": level, **evaluated(noise(level))} for level in NOISE],
        "single": single,
    }


def _disturbed(rows: Rows, start: StartFault) -> Rows:
    """The rows with each episode's pressures read through the fault that starts there."""
    inputs = rows.inputs.clone()
    for span in rows.spans():
        fault = start(span.stop - span.start)
        inputs[span, :-1] = torch.from_numpy(fault(rows.inputs[span, :-1].numpy()))
    return replace(rows, inputs=inputs)


def _slid(encoder: Encoder, teacher: WakeModel, rows: Rows) -> list[list[float]]:
    latents = encode_all(encoder, rows)
    full = ~latents[:, 0].isnan()
    with torch.no_grad():
        decoded = teacher.decoder(latents[full])
    found: list[list[float]] = sliding_error(decoded, rows.forces[full], SLIDE)[::THIN].tolist()
    return found


def _frequencies() -> np.ndarray[Any, Any]:
    """Of the extended chirp at the middle of each sliding window that is kept: it sweeps evenly in time."""
    (episode,) = episodes("extended")
    forcing: Any = episode.provenance["forcing"]
    first, last = (float(forcing[f"extended_chirp_{end}"]) for end in ("start", "end"))
    along = np.linspace(first, last, len(episode))
    window = 32
    middles = along[window - 1 + SLIDE // 2 :][: len(episode) - window + 1 - SLIDE + 1]
    return middles[::THIN]


def _amplified(lab: Lab, slim: Encoder, teacher: WakeModel, scaling: Scaling, chosen: Any) -> dict[str, Any]:
    path = lab.folder.parent / "amplitude.h5"
    if not path.exists():
        flow = replace(lab.config.flow, action_limit=LIMIT)
        plan = EpisodePlan(forcing="chirp", steps=STEPS, seed=0)
        record(path, (plan,), replace(lab.config, flow=flow), workers=1)
    rows = prepare(dataset.read(path).with_role("test"), scaling, mirrored=False)
    return {
        "limit": LIMIT,
        "teacher": evaluate(teacher.encoder, teacher, rows).as_tree(),
        "slim": evaluate(slim, teacher, rows.with_sensors(chosen)).as_tree(),
    }
