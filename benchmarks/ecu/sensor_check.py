"""The ECU's sensor check over the whole recording: false alarms per hour, and the time to find a faulty sensor.

    python -m benchmarks sensor-check --json results/sensor_check.json

The shipped bundle's check reads the recording as the ECU would, rounded to the signal's resolution. In the first part
the sensors are healthy; some passages have noise or lost frames. A false alarm excludes a sensor, or reports an
implausible state, which would shut the jets. After a false alarm the check starts again. In the second part faults
start at many places of the recording. The recorded flow does not respond to the check, as it would in the closed loop.

NumPy computes the estimates of a whole episode together, with the constants of the check's ONNX graph; the first ones
are compared with ONNX Runtime's. The ECU's code does everything else, period by period.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from math import log
from time import perf_counter
from types import SimpleNamespace
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from benchmarks.common.command_line import JsonFile, report, track
from benchmarks.ecu.tables import alarms, faults
from can_bridge.wire.message_specs import PRESSURE_RESOLUTION_PA
from contract.arrays import Array
from contract.config.tree import Config
from contract.controller.estimator import ESTIMATOR, EstimatorNetwork, pairs
from contract.errors import StillwakeError
from contract.recording import dataset
from contract.release.checks import Bundle
from contract.results import versions
from contract.shipped import RECORDING
from ecu.sensor_check import SensorCheck, SensorCheckState, sensor_check_of
from export.to_onnx.sensor_estimator import read_estimator
from firmware_sim.bench.sensor_faults import Bias, Dead, Drift, Noise, SensorDisturbance, SensorFault, Stuck, Swap
from stillwake.parts.releases import open_release

LONGEST: Final = 250
"""Number of periods from a fault's start within which the fault must be found: ten shedding cycles."""
FIRST, EVERY = 200, 1500
"""Smallest step number at which a fault starts in an episode, and number of steps between two such places."""
DRIFT_PERIODS: Final = 100
DISTURBED: Final = ("none", "noise 0.9", "lost 0.3")
"""Disturbances of healthy sensors' readings: noise in global deviations, or a share of lost frames."""


class Passage(NamedTuple):
    """An episode of n steps as the ECU reads it from S sensors: the readings, shape (n, S), the actions in force, shape
    (n,), and whether the frame of each step arrived, shape (n,)."""

    role: str
    cp: Array
    actions: Array
    heard: npt.NDArray[np.bool_]


class Moment(NamedTuple):
    """A step of the recording at which a fault may start, with the state of the check before this step."""

    passage: Passage
    step: int
    state: SensorCheckState


class Lab(NamedTuple):
    """The shipped sensor check with the ECU's settings; NumPy computes its estimator network."""

    check: SensorCheck
    network: EstimatorNetwork

    def read(
        self, passage: Passage, state: SensorCheckState, first: int = 0, *, restart: SensorCheckState | None = None
    ) -> Iterator[tuple[int, SensorCheckState, SensorCheckState]]:
        """Yield each step from `first` on, with the check's states before and after the step. After an alarm the check
        restarts from `restart`, or continues if `restart` is None."""
        length = self.network.window
        windows = _windows(passage, length)[first:]
        # This estimator returns estimates that were computed in advance; `now` is the estimate of the present step.
        ahead: Any = SimpleNamespace(estimates=lambda window: ahead.now)
        check = replace(self.check, estimator=ahead)
        for step, (window, ahead.now) in enumerate(zip(windows, _estimates(self.network, windows), strict=True), first):
            before, cp = state, passage.cp[step] if passage.heard[step] else None
            state, _ = check.next(before, window, min(step + 1, length), cp)
            yield step, before, state
            if restart is not None and _is_alarm(state):
                state = restart

    def agrees(self, passage: Passage) -> None:
        """Compare NumPy's and ONNX Runtime's estimates; raises StillwakeError if they differ."""
        windows = _windows(passage, self.network.window)[:100]
        found = np.stack([self.check.estimator.estimates(window) for window in windows])
        # NumPy and ONNX Runtime compute in single precision, with sums of some hundred terms of order one, so small
        # differences are expected.
        if not np.allclose(found, _estimates(self.network, windows), atol=1e-5):
            raise StillwakeError("NumPy and ONNX Runtime estimate different pressures from the same constants")


class Outcome(NamedTuple):
    """The result of a fault: the excluded sensor, whether the jets were shut, and the number of periods until then."""

    set_aside: int | None
    shut: bool
    periods: int


def main(json_file: JsonFile = None) -> None:
    """Measure the false alarms of the sensor check, and the result of each fault."""
    config = Config()
    release = open_release(None)
    check = sensor_check_of(release, config)
    if check is None:
        raise StillwakeError(f"bundle {release.manifest.name}: has no sensor estimator")
    passages = _passages(release, config)
    heard, moments = [], list[Moment]()
    lab = Lab(check=check, network=read_estimator(release.files[ESTIMATOR]).network)
    lab.agrees(passages[0])
    for through in DISTURBED:
        for passage in track(passages, f"sound sensors, {through}", "episodes"):
            count, found = _false_alarms(lab, _read_through(passage, through))
            heard.append((through, passage.role, len(passage.cp), count))
            moments += found if through == "none" else []
    figures = {
        "false_alarms": _rates(heard, config),
        "faults": _faults(lab, release, moments),
        "step_us": _times(check, moments[0], release.manifest.window),
    }
    settings = {"every": EVERY, "longest": LONGEST, "sensor_check": vars(config.ecu.sensor_check)}
    facts = {"bundle": release.manifest.name, "digest": release.digest, **settings}
    report(json_file, figures, facts | {"versions": versions("numpy", "onnxruntime")}, alarms, faults)


def _passages(release: Bundle, config: Config) -> list[Passage]:
    recording = dataset.read(RECORDING)
    columns = recording.layout.indices(release.manifest.sensors)
    step = PRESSURE_RESOLUTION_PA / config.operating_point.dynamic_pressure
    return [
        Passage(
            role="controlled" if item.provenance["forcing_signal"] == "controlled" else item.role,
            cp=np.round(item.series["Cp"][:, columns] / step) * step,
            actions=item.previous_action,
            heard=np.ones(len(item), dtype=bool),
        )
        for item in recording.episodes
    ]


def _read_through(passage: Passage, through: str) -> Passage:
    kind, _, level = through.partition(" ")
    if kind == "noise":
        return passage._replace(cp=Noise(level=float(level)).begun((), Config(), seed=1)(passage.cp))
    if kind == "lost":
        return passage._replace(heard=np.random.default_rng(1).random(len(passage.cp)) >= float(level))
    return passage


def _windows(passage: Passage, length: int) -> Array:
    """Return the controller's window of L rows at each of the n steps, shape (n, L, S+1). If a frame was lost, its row
    repeats the previous pressures."""
    last = np.maximum.accumulate(np.where(passage.heard, np.arange(len(passage.cp)), 0))
    rows = np.column_stack([passage.cp[last], passage.actions])
    padded = np.concatenate([np.repeat(rows[:1], length - 1, axis=0), rows])
    return np.lib.stride_tricks.sliding_window_view(padded, length, axis=0).transpose(0, 2, 1)


def _estimates(network: EstimatorNetwork, windows: Array) -> Array:
    parts = (windows[first : first + 500] for first in range(0, len(windows), 500))
    return np.concatenate([network.estimates(part) for part in parts])


def _false_alarms(lab: Lab, passage: Passage) -> tuple[int, list[Moment]]:
    """Return the number of false alarms, and the places where a fault may start."""
    fresh = SensorCheckState.start(window=lab.network.window, sensors=lab.network.sensors)
    alarms, moments = 0, []
    for step, before, after in lab.read(passage, fresh, restart=fresh):
        if step in range(FIRST, len(passage.cp) - LONGEST + 1, EVERY):
            moments.append(Moment(passage=passage, step=step, state=before))
        alarms += _is_alarm(after)
    return alarms, moments


def _is_alarm(state: SensorCheckState) -> bool:
    return state.set_aside is not None or state.implausible


def _rates(alarms: Sequence[tuple[str, str, int, int]], config: Config) -> list[dict[str, Any]]:
    found = []
    for through in DISTURBED:
        roles = dict.fromkeys(role for one, role, _, _ in alarms if one == through)
        for role in (*roles, "all"):
            chosen = [item for item in alarms if item[0] == through and role in (item[1], "all")]
            hours = sum(item[2] for item in chosen) * config.period_ns / 3.6e12
            count = sum(item[3] for item in chosen)
            # If there was no alarm, the true rate is below this bound with 95 % confidence (Poisson).
            bound = -log(0.05) / hours if count == 0 else None
            found.append({"through": through, "role": role, "hours": hours, "alarms": count,
                          "per_hour": count / hours, "below_per_hour": bound})  # fmt: skip
    return found


def _faults(lab: Lab, release: Bundle, moments: Sequence[Moment]) -> list[dict[str, Any]]:
    names = release.manifest.sensors
    over_s = (DRIFT_PERIODS - 1) * Config().period_ns / 1e9
    single: dict[str, SensorDisturbance] = {
        "dead": Dead(sensor=""),
        "stuck": Stuck(sensor=""),
        **{f"bias {level:+d}": Bias(sensor="", level=float(level)) for level in (1, -1, 2, -2)},
        f"drift 2 in {DRIFT_PERIODS}": Drift(sensor="", level=2.0, over_s=over_s),
    }
    swap = Swap(sensors=("one", "other"))
    double: dict[str, SensorDisturbance] = {
        "swapped": swap,
        "both dead": single["dead"],
        "both biased +2": single["bias +2"],
    }
    cases = [(name, tuple[int, ...]((j,)), one) for name, one in single.items() for j in range(len(names))]
    cases += [(name, pair, one) for name, one in double.items() for pair in pairs(len(names))]
    found = []
    for name, liars, one in track(cases, "faults", "kinds and sensors"):
        places = (liars,) if one is swap else [(j,) for j in liars]
        begun = ([one.begun(place, Config(), seed=0) for place in places] for _ in moments)
        outcomes = list(map(partial(_outcome, lab), moments, begun))
        named = [one for one in outcomes if one.set_aside in liars or one.shut]
        periods = [one.periods for one in named]
        found.append({
            "fault": name, "sensor": "+".join(names[j] for j in liars), "starts": len(outcomes),
            "set_aside": sum(one.set_aside in liars and not one.shut for one in outcomes),
            "shut": sum(one.shut for one in outcomes),
            "wrong": sum(one.set_aside is not None and one.set_aside not in liars and not one.shut for one in outcomes),
            "unseen": sum(one.set_aside is None and not one.shut for one in outcomes),
            "periods_median": float(np.median(periods)) if periods else None,
            "periods_max": max(periods, default=None),
        })  # fmt: skip
    return found


def _outcome(lab: Lab, moment: Moment, faults: Sequence[SensorFault]) -> Outcome:
    passage, begin = moment.passage, moment.step
    cp = passage.cp[begin : begin + LONGEST]
    for fault in faults:
        cp = fault(cp)
    faulty = passage._replace(cp=np.concatenate([passage.cp[:begin], cp]), actions=passage.actions[: begin + LONGEST],
                              heard=passage.heard[: begin + LONGEST])  # fmt: skip
    state, first = moment.state, None
    for step, _, state in lab.read(faulty, moment.state, begin):
        if state.implausible:
            return Outcome(set_aside=state.set_aside, shut=True, periods=step - begin + 1)
        if first is None and state.set_aside is not None:
            first = step - begin + 1
            if len(faults) == 1:
                break
    return Outcome(set_aside=state.set_aside, shut=False, periods=first or LONGEST)


def _times(check: SensorCheck, moment: Moment, length: int) -> dict[str, float]:
    cp, window, took = moment.passage.cp[moment.step], _windows(moment.passage, length)[moment.step], []
    for _ in range(2000):
        began = perf_counter()
        check.next(moment.state, window, length, cp)
        took.append((perf_counter() - began) * 1e6)
    return {"p50": float(np.percentile(took, 50)), "p99": float(np.percentile(took, 99))}
