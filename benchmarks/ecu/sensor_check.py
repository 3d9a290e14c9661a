"""The ECU's sensor check over the whole recording: false alarms an hour, and how soon it finds which liar.

    python -m benchmarks sensor-check --json results/sensor_check.json

The shipped bundle's check reads the recording as the ECU would, rounded to the wire's steps. First with sound sensors,
also with noise and with frames lost: every sensor set aside, and every doubt that would shut the jets, is a false alarm,
after which the check starts anew. Then with faults that begin at many places of the recording. The flow does not answer
here as it does in the loop, where a liar moves the jets.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import log
from pathlib import Path
from time import perf_counter
from typing import Annotated, Any, Final, NamedTuple

import numpy as np
import typer
from rich.table import Table

from benchmarks.common.command_line import JsonFile, console, save, track
from can_bridge.wire.message_specs import PRESSURE_RESOLUTION_PA
from contract.arrays import Array
from contract.config.tree import Config
from contract.errors import StillwakeError
from contract.recording import dataset
from contract.release.bundle import Bundle
from contract.sensor_faults import Bias, Dead, Drift, Noise, SensorFault, Swapped, Zero
from firmware_sim.bench.disturbances import GLOBAL_DEVIATION
from firmware_sim.ecu.ecu import sensor_check_of
from firmware_sim.ecu.sensor_check import SensorCheck, SensorCheckState
from stillwake.releases import open_release
from wake.shipped import RECORDING

LONGEST: Final = 250
"""Periods after a fault's begin in which it is to be found: ten shedding cycles."""
FIRST: Final = 200
"""Of an episode, from which on faults begin."""
DRIFT_PERIODS: Final = 100
DISTURBED: Final = ("none", "noise 0.5", "noise 0.9", "lost 0.1", "lost 0.3")
"""What sound sensors are read through, besides the wire: noise in global deviations, frames lost at random."""


class Passage(NamedTuple):
    """An episode as the ECU reads it.

    Attributes:
        role: of the episode.
        cp: (n, S) readings.
        actions: (n,) in force.
        heard: (n,) whether the frame came.
    """

    role: str
    cp: Array
    actions: Array
    heard: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Moment:
    """Where a fault may begin.

    Attributes:
        passage: the episode.
        step: the first faulty one.
        state, window: of the ECU after the step before.
    """

    passage: Passage
    step: int
    state: SensorCheckState
    window: Array


class Outcome(NamedTuple):
    """What came of a fault: the sensor set aside, whether the jets were shut instead, and after how many periods."""

    set_aside: int | None
    shut: bool
    periods: int


def main(
    bundle: Annotated[Path | None, typer.Option(help="Bundle; default: the shipped one.")] = None,
    every: Annotated[int, typer.Option(help="Control steps between two places where faults begin.", min=1)] = 1500,
    json_file: JsonFile = None,
) -> None:
    """False alarms of the sensor check, and what it finds of each fault."""
    config = Config()
    release = open_release(bundle, None)
    check = sensor_check_of(release, config)
    if check is None:
        raise StillwakeError(f"bundle {release.manifest.name}: has no sensor estimator")
    passages = _passages(release, config)
    alarms, moments = [], list[Moment]()
    length = release.manifest.window
    for through in DISTURBED:
        places = every if through == "none" else None
        for passage in track(passages, f"sound sensors, {through}", "episodes"):
            found = list(_false_alarms(check, length, _read_through(passage, through), places))
            alarms.append((through, passage.role, len(passage.cp), sum(isinstance(one, str) for one in found)))
            moments += [one for one in found if isinstance(one, Moment)]
    figures: dict[str, Any] = {
        "false_alarms": _rates(alarms, config),
        "faults": _faults(check, release, moments),
        "step_us": _times(check, moments[0]),
    }
    for name in ("false_alarms", "faults"):
        rows = figures[name]
        table = Table(*rows[0])
        for row in rows:
            table.add_row(*(f"{value:.3g}" if isinstance(value, float) else str(value) for value in row.values()))
        console.print(table)
    console.print("a step of the check: " + ", ".join(f"{name} {value:.0f} us" for name, value in figures["step_us"].items()))
    save(json_file, figures=figures, facts={"bundle": release.manifest.name, "digest": release.digest, "every": every,
         "longest": LONGEST, "sensor_check": vars(config.ecu.sensor_check)})  # fmt: skip


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
        unit = np.full(passage.cp.shape[1], GLOBAL_DEVIATION)
        return passage._replace(cp=Noise(float(level), unit, seed=1)(passage.cp))
    if kind == "lost":
        return passage._replace(heard=np.random.default_rng(1).random(len(passage.cp)) >= float(level))
    return passage


def _stepped(
    check: SensorCheck, state: SensorCheckState, window: Array, rows: int, passage: Passage, step: int
) -> tuple[SensorCheckState, Array, int]:
    """One period: the window's new row, without pressures the last ones again, and the check."""
    heard = bool(passage.heard[step])
    cp = passage.cp[step]
    row = np.append(cp if heard or not rows else window[-1, :-1], passage.actions[step])
    window, rows = np.concatenate([window[1:], row[None]]), min(rows + 1, len(window))
    state, _ = check.next(state, window, rows, cp if heard else None)
    return state, window, rows


def _false_alarms(check: SensorCheck, length: int, passage: Passage, every: int | None) -> Iterator[str | Moment]:
    """A word for every false alarm, and the places where faults may begin."""
    sensors = passage.cp.shape[1]
    fresh = SensorCheckState.start(window=length, sensors=sensors)
    state, window, rows = fresh, np.zeros((length, sensors + 1)), 0
    for step in range(len(passage.cp)):
        if every and step >= FIRST and (step - FIRST) % every == 0 and step + LONGEST <= len(passage.cp):
            yield Moment(passage=passage, step=step, state=state, window=window)
        state, window, rows = _stepped(check, state, window, rows, passage, step)
        if state.set_aside is not None or state.implausible:
            yield "shut" if state.implausible else "set aside"
            state, window, rows = fresh, np.zeros((length, sensors + 1)), 0


def _rates(alarms: Sequence[tuple[str, str, int, int]], config: Config) -> list[dict[str, Any]]:
    found = []
    for through in DISTURBED:
        roles = dict.fromkeys(role for one, role, _, _ in alarms if one == through)
        for role in (*roles, "all"):
            chosen = [item for item in alarms if item[0] == through and role in (item[1], "all")]
            hours = sum(item[2] for item in chosen) * config.period_ns / 3.6e12
            count = sum(item[3] for item in chosen)
            # With none, the rate is below this at 95 % confidence (Poisson).
            bound = -log(0.05) / hours if count == 0 else None
            found.append({"through": through, "role": role, "hours": hours, "alarms": count,
                          "per_hour": count / hours, "below_per_hour": bound})  # fmt: skip
    return found


def _faults(check: SensorCheck, release: Bundle, moments: Sequence[Moment]) -> list[dict[str, Any]]:
    names = release.manifest.sensors
    unit = np.full(len(names), GLOBAL_DEVIATION)
    single: dict[str, Callable[[int], SensorFault]] = {
        "dead": Zero,
        "stuck": Dead,
        "bias +1": lambda j: Bias(1.0, unit, j),
        "bias -1": lambda j: Bias(-1.0, unit, j),
        "bias +2": lambda j: Bias(2.0, unit, j),
        "bias -2": lambda j: Bias(-2.0, unit, j),
        f"drift 2 in {DRIFT_PERIODS}": lambda j: Drift(2.0, unit, j, steps=DRIFT_PERIODS),
    }
    cases = [(name, (j,), lambda j=j, make=make: [make(j)]) for name, make in single.items() for j in range(len(names))]
    both = [(i, j) for i in range(len(names)) for j in range(i + 1, len(names))]
    cases += [("swapped", pair, lambda pair=pair: [Swapped(*pair)]) for pair in both]
    cases += [("both dead", pair, lambda pair=pair: [Zero(j) for j in pair]) for pair in both]
    cases += [("both biased +2", pair, lambda pair=pair: [Bias(2.0, unit, j) for j in pair]) for pair in both]
    found = []
    for name, liars, make in track(cases, "faults", "kinds and sensors"):
        outcomes = [_outcome(check, moment, make()) for moment in moments]
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


def _outcome(check: SensorCheck, moment: Moment, faults: Sequence[SensorFault]) -> Outcome:
    passage = moment.passage
    cp = passage.cp[moment.step : moment.step + LONGEST]
    for fault in faults:
        cp = fault(cp)
    faulty = passage._replace(cp=cp, actions=passage.actions[moment.step :], heard=passage.heard[moment.step :])
    state, window, rows = moment.state, moment.window, len(moment.window)
    first: int | None = None
    for step in range(LONGEST):
        state, window, rows = _stepped(check, state, window, rows, faulty, step)
        if state.implausible:
            return Outcome(set_aside=state.set_aside, shut=True, periods=step + 1)
        if first is None and state.set_aside is not None:
            first = step + 1
            if len(faults) == 1:
                break
    return Outcome(set_aside=state.set_aside, shut=False, periods=first or LONGEST)


def _times(check: SensorCheck, moment: Moment) -> dict[str, float]:
    cp, took = moment.passage.cp[moment.step], []
    for _ in range(2000):
        began = perf_counter()
        check.next(moment.state, moment.window, len(moment.window), cp)
        took.append((perf_counter() - began) * 1e6)
    return {"p50": float(np.percentile(took, 50)), "p99": float(np.percentile(took, 99))}
