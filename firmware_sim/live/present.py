"""The messages that describe a run of the loop: constants of the run, and values of each period."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from importlib.metadata import version
from typing import Any, Final

import numpy as np

from can_bridge.wire.messages import Reason
from contract.arrays import Array, Index
from contract.config.tree import Config
from contract.geometry import HALF_WIDTH, JET_WIDTH
from contract.release.checks import Bundle
from firmware_sim.live.loop.live_run import LivePeriod, LiveRun
from firmware_sim.live.loop.messages import KEPT_PERIODS, PERIOD_COLUMNS, Choice, LiveMessage, periods_message
from firmware_sim.live.loop.noticing import UNPOWERED, SeenState
from firmware_sim.live.settings import SLIDERS, WEIGHT, LiveSettings
from firmware_sim.runs.reasons import BECAUSE
from firmware_sim.runs.statistics import rounded
from wake.pictures.drawing import outline

_DIGITS: Final = 5  # number of decimals of plotted values; more decimals would not be visible


def hello(
    run: LiveRun, bundle: Bundle, config: Config, settings: LiveSettings, *, choices: Mapping[str, Sequence[Choice]]
) -> LiveMessage:
    """Return the message with the constants of this run and the settings. Positions are in W; the nose is at x = 0."""
    manifest, layout, base = bundle.manifest, run.wake.layout, config.body.length
    slot = HALF_WIDTH - 0.5 * JET_WIDTH
    return {
        "type": "hello",
        "version": version("stillwake"),
        "bundle": {
            "name": manifest.name,
            "digest": bundle.digest[:12],
            "precision": manifest.precision,
            "signer": "" if bundle.signer is None else bundle.signer.fingerprint,
        },
        "run": run.number,  # number of the plant's start; k and t begin at 0 in each run
        "period_ms": config.period_ns / 1e6,
        "control_period": config.flow.control_period,  # in t_c
        "action_limit": config.flow.action_limit,
        "horizon": manifest.mpc.horizon,
        "delay_steps": config.ecu.delay_steps,
        "reynolds": config.flow.reynolds,
        "refinement": config.flow.refinement,
        "plant": run.wake.description,
        "answers_jets": bool(getattr(run.wake, "answers_jets", True)),
        "sensors": [
            {"name": name, "x": float(x), "y": float(y)}
            for name, (x, y) in zip(layout.names, layout.positions, strict=True)
        ],
        "used": list(manifest.sensors),  # in the order of the Pressure message
        "body": outline(config.body).tolist(),
        "jets": [[base, slot], [base, -slot]],  # upper slot, lower slot
        "view": list(run.levels.view) if run.levels else [],  # x and y limits of the picture, in W
        "raster": list(run.levels.size) if run.levels else [],  # width and height of the picture in pixels
        "reasons": {reason.name: text for reason, text in BECAUSE.items()},
        **{f"{what}s": list(found) for what, found in choices.items()},  # keys: controllers and plants
        "sliders": {name: asdict(slider) for name, slider in SLIDERS.items()},
        "weights": asdict(manifest.mpc.weights),
        "weight_slider": asdict(WEIGHT),
        "settings": asdict(settings),
        "kept": KEPT_PERIODS,
    }


def periods(run: int, new: Iterable[LivePeriod], base: Index) -> LiveMessage:
    """Return the message about the new periods. `base` has the indices of the base sensors."""
    return periods_message(run, ([rounded(value, 9) for value in _values(period, base)] for period in new))


def now(run: LiveRun, latest: LivePeriod, seen: SeenState, *, fps: float, paused: bool) -> LiveMessage:
    """Return the message about the latest period."""
    forces = run.ecu.ecu.trace.forces
    planned = forces is not None and latest.is_planned
    # The plan's first action acts during period k; sample k + 1, at the end of this period, is the first to show it.
    return {
        "type": "now",
        "run": run.number,
        "k": latest.k,
        "t": latest.row.sample.t,
        "time_s": run.time_s(latest.k),
        "state": seen.state,  # name of an `OperatingMode`, or UNPOWERED or BOOT
        "reason": Reason(seen.reason).name,
        "set_aside": list(seen.set_aside),
        "given_up": seen.given_up,
        "plan": _rounded(run.state.memory.plan) if planned else [],
        "plan_from": latest.k + 1,  # period whose sample shows the effect of the plan's first action
        "forecast": _rounded(forces) if planned else [],  # Cd and Cl for the same periods
        "cp": _rounded(latest.row.sample.Cp),  # pressures at all sensors of the body
        "read": [rounded(value, 9) for value in _rounded(run.disturbances.read)],  # readings of the transducers
        "uncontrolled_Cd": run.drag.uncontrolled,
        "drag_Cd": run.drag.now,
        "reduction_percent": run.drag.reduction_percent,
        "fps": fps,  # control periods per second of the wall clock
        "real_time": fps * run.period_ns / 1e9,  # virtual seconds per second of the wall clock
        "paused": paused,
        "computed_by": "" if seen.state == UNPOWERED else run.ecu.computed_by,
    }


def _values(period: LivePeriod, base: Index) -> list[float]:
    row, sample = period.row, period.row.sample
    own = {
        "k": period.k,
        "t": sample.t,
        "Cd": sample.Cd,
        "Cl": sample.Cl,
        "base_Cp": float(np.mean(sample.Cp[base])) if len(base) else float("nan"),
        "action": sample.action,
        "requested": int(period.requested),
    }
    return [own[name] if name in own else getattr(row, name) for name in PERIOD_COLUMNS]


def _rounded(values: Array | None) -> Any:
    return np.round(np.asarray(values, dtype=np.float64), _DIGITS).tolist()
