"""Rows of the controllers that are a formula, each with the constants that a grid on the coarse mesh found best.

A trial is 10 t_c without control and 40 with it, from one phase, of which the last 20 count, through bus and ECU as the
row. Judged by the wall's mean drag and the release's prices of lift: Cd + 0.1 mean |Cl| + 0.3 (mean Cl)^2.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np

from benchmarks.common.command_line import track
from benchmarks.common.parts import part
from benchmarks.roads.coarse import coarse, coarse_start
from benchmarks.roads.cost import m7_ms, median_step_ms
from benchmarks.roads.laws import BangBang, Constant, Opposition, PhaseControl, Proportional, Sine
from benchmarks.roads.loop import (
    MIRROR_SENSORS,
    SPANS,
    Law,
    LawController,
    Setting,
    controller_law,
    mounted,
    through_can,
)
from benchmarks.roads.release import recorded_periods
from benchmarks.roads.row import Outcome, Row
from contract.config.tree import Config
from contract.release import bundle as bundles
from contract.release.checks import Bundle
from contract.runtime.onnx_session import OnnxController
from contract.shipped import BUNDLE
from firmware_sim.bench.spans import Spans
from wake.truck.state import State

TRIAL: Final = Spans(lead_in=10.0, controlled=40.0, settle=20.0)
SIDES: Final = (0, 1)
"""Columns of the pair on the sides, upper and lower; the pair on the base is (2, 3)."""
BASE: Final = (2, 3)
Constants = Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class Formula:
    """A baseline.

    Attributes:
        make: the law from its constants, the vehicle and the release.
        grid: constants to try.
        scaled: of the best of them, a constant's name and what it is then multiplied by.
        finalists: so many of the best trials are tried again over the row's time; the wake locks onto a sine late.
        products: multiply-accumulates of a step; None where it is another controller's step.
        own_sensors: whether it reads the release's sensors; the mirror-placed pairs otherwise.
    """

    title: str
    make: Callable[[Constants, Config, Bundle], Law]
    grid: Sequence[Constants]
    products: int | None
    scaled: tuple[str, tuple[float, ...]] | None = None
    finalists: int = 1
    own_sensors: bool = False
    window: int = 32


def _shifts(count: int) -> list[float]:
    return [round(2.0 * np.pi * k / count, 4) for k in range(count)]


FORMULAS: Final = {
    "constant": Formula(
        title="constant blowing and sucking",
        make=lambda c, config, release: Constant(action=c["action"]),
        grid=[{"action": action} for action in (0.01, 0.03, 0.075)],
        products=0,
    ),
    "sine": Formula(
        title="sine without feedback",
        make=lambda c, config, release: Sine(**c, period=config.flow.control_period),
        grid=[
            {"amplitude": amplitude, "frequency": frequency, "phase": phase}
            for amplitude, frequency in ((0.075, 0.19), (0.075, 0.2))
            for phase in _shifts(3)
        ],
        scaled=("amplitude", (0.5,)),
        finalists=3,
        products=4,
    ),
    "proportional": Formula(
        title="proportional to the base pressure difference",
        make=lambda c, config, release: Proportional(gain=c["gain"], delay=int(c["delay"]), columns=BASE),
        grid=[{"gain": gain, "delay": delay} for gain in (0.1, -0.1) for delay in (0, 3, 6, 9)],
        scaled=("gain", (0.3, 3.0)),
        products=1,
    ),
    "opposition": Formula(
        title="opposition to the side pressure difference's rate",
        make=lambda c, config, release: Opposition(
            gain=c["gain"], columns=SIDES, period=config.flow.control_period, over=2
        ),
        grid=[{"gain": gain} for gain in (0.03, -0.03)],
        scaled=("gain", (0.3, 3.0)),
        products=2,
    ),
    "phase-control": Formula(
        title="sine locked to the shedding's phase",
        make=lambda c, config, release: PhaseControl(**c, columns=SIDES, period=config.flow.control_period),
        grid=[{"amplitude": 0.04, "shift": shift} for shift in _shifts(8)],
        scaled=("amplitude", (0.4, 1.875)),
        products=3 * 32,
    ),
    "bang-bang": Formula(
        title="bang-bang: the sign of the release's plan",
        make=lambda c, config, release: BangBang(
            controller_law(OnnxController.of(release), release.manifest.mpc.horizon),
            limit=c["level"],
            dead=c["dead"],
        ),
        grid=[{"level": level, "dead": dead} for level, dead in ((0.075, 0.0), (0.075, 0.02), (0.04, 0.01))],
        products=None,
        own_sensors=True,
    ),
}


def measure(road: str, setting: Setting) -> Row:
    """The row of a formula, with the best of its grid."""
    formula, release = FORMULAS[road], bundles.load(BUNDLE)
    ranked = tuned(formula, partial(kept_trial, formula, setting, release, TRIAL), road)
    finals, trials = ranked[: formula.finalists], len(ranked)
    chosen = finals[0]
    if len(finals) > 1:
        chosen = min(
            track(finals, f"{road}: finals", "trials"), key=partial(kept_trial, formula, setting, release, SPANS)
        )
    config = setting.config

    def run(start: State) -> Outcome:
        controller = controller_of(formula, chosen, config, release)
        return through_can(bundle_for(formula, release), config, start, controller)

    sizes = bundle_for(formula, release).manifest.sizes
    (_, short), (_, long) = (spans.periods(config.flow.control_period) for spans in (TRIAL, SPANS))
    interactions = short * trials + (long * len(finals) if len(finals) > 1 else 0)
    if formula.own_sensors:
        # It thresholds the release's plan, whose model was recorded for.
        interactions += recorded_periods()
    words = ", ".join(f"{name} {value:g}" for name, value in chosen.items())
    return Row(
        road=road,
        title=formula.title,
        kind="baseline",
        outcomes=setting.outcomes(run, _name(chosen)),
        sensors=0 if road in ("constant", "sine") else sizes.sensors,
        loop="CAN",
        mesh=setting.mesh,
        interactions=interactions,
        step_ms=part(
            setting.folder / "step_ms.json",
            lambda: median_step_ms(controller_of(formula, chosen, config, release), sizes),
        ),
        m7_ms=None if formula.products is None else m7_ms(formula.products),
        note=f"best of {trials} trials: {words}",
    )


def tuned(formula: Formula, judge: Callable[[Constants], float], label: str) -> list[Constants]:
    """The constants of the grid and of the scaled neighbours of its best, the best first."""
    tried = [(judge(constants), constants) for constants in track(formula.grid, f"{label}: grid", "trials")]
    best = min(tried, key=lambda one: one[0])[1]
    if formula.scaled is not None:
        name, factors = formula.scaled
        neighbours = [{**best, name: best[name] * factor} for factor in factors]
        tried += [(judge(constants), constants) for constants in track(neighbours, f"{label}: scaled", "trials")]
    return [constants for _, constants in sorted(tried, key=lambda one: one[0])]


def kept_trial(formula: Formula, setting: Setting, release: Bundle, spans: Spans, constants: Constants) -> float:
    """What a trial is judged by; it is kept by its constants."""
    label = "trial" if spans is TRIAL else "final"
    found = part(
        setting.folder / f"{label}_{_name(constants)}.json", partial(trial, formula, constants, setting, release, spans)
    )
    return judged(found)


def _name(constants: Constants) -> str:
    return "_".join(f"{value:g}" for value in constants.values())


def trial(formula: Formula, constants: Constants, setting: Setting, release: Bundle, spans: Spans) -> dict[str, Any]:
    """A short run on the coarse mesh, and its judgement."""
    config = coarse(setting.config)
    start = coarse_start(setting.folder.parent, config)
    controller = controller_of(formula, constants, config, release)
    outcome = through_can(bundle_for(formula, release), config, start, controller, spans=spans)
    return {**constants, "Cd": outcome.Cd, "abs_Cl": outcome.abs_Cl, "mean_Cl": outcome.mean_Cl}


def judged(found: Mapping[str, float]) -> float:
    """What a trial is chosen by: the least."""
    return found["Cd"] + 0.1 * found["abs_Cl"] + 0.3 * found["mean_Cl"] ** 2


def controller_of(formula: Formula, constants: Constants, config: Config, release: Bundle) -> LawController:
    """A fresh one: a law may count its steps."""
    return LawController(
        formula.make(constants, config, release),
        horizon=release.manifest.mpc.horizon,
        limit=config.flow.action_limit,
        description=formula.title,
    )


def bundle_for(formula: Formula, release: Bundle) -> Bundle:
    """Settings of the vehicle that is read: without the check of the sensors, which knows the release's flows alone."""
    sensors = release.manifest.sensors if formula.own_sensors else MIRROR_SENSORS
    return mounted(release, sensors, formula.window)
