"""The steady symmetric wake: the flow that would be left if shedding were suppressed by symmetry.

A flow that starts symmetric stays so but for rounding, on which the shedding instability feeds. Taking the even part of
the flow after every control period removes that, and what remains settles. The result solves the same discrete
equations as the shedding wake, so its drag says how much of the drag is shedding's.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from datetime import date
from math import log10
from pathlib import Path
from typing import Any, Final

import numpy as np

from contract import sensors
from contract.config.tree import FlowConfig
from contract.errors import PlantError
from contract.results import versions, write_result
from wake.solver.flow import Flow
from wake.truck.develop import start_from_rest
from wake.truck.recirculation import recirculation_length
from wake.truck.truck_wake import Sample, State, TruckWake, save_state

TOLERANCE: Final = 1e-6
"""In the last stage rates fall by a factor e in about 23 t_c: forces are then final to some 1e-5."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SteadyWake:
    """A wake that has settled.

    Attributes:
        state: the flow, its clock set to zero; the plant is left in it.
        sample: what the plant shows in it.
        recirculation_length: from the base to where the velocity on the axis turns downstream, in W.
        velocity_rate: max |du/dt| and |dv/dt| over the last control period, in U_inf / t_c.
        drag_rate: |dCd/dt| over it, wall and slots, in 1 / t_c.
        time: how long the flow took from rest, in t_c.
    """

    state: State
    sample: Sample
    recirculation_length: float
    velocity_rate: float
    drag_rate: float
    time: float

    def figures(self) -> dict[str, float]:
        """For a results file."""
        sample = self.sample
        return {
            "Cd": sample.Cd,
            "Cd_slot": sample.Cd_slot,
            "base_Cp": float(sample.Cp[sensors.BASE].mean()),
            "recirculation_length": self.recirculation_length,
            "velocity_rate": self.velocity_rate,
            "drag_rate": self.drag_rate,
            "time": self.time,
        }


def settle(
    wake: TruckWake,
    tolerance: float = TOLERANCE,
    longest: float = 600.0,
    progress: Callable[[float, float], None] = lambda t, rate: None,
) -> SteadyWake:
    """Evolve the symmetric flow from rest, without action, until neither velocity nor drag changes.

    Args:
        wake: the plant.
        tolerance: both rates must fall below this.
        longest: give up after so many t_c.
        progress: called with the time and the larger rate after every control period.

    Raises:
        PlantError: if the flow is not steady after `longest`.
    """
    start_from_rest(wake)
    period = wake.config.control_period
    before, drag = wake.flow.velocities.copy(), _drag(wake.sample())
    while wake.t < longest:
        wake.advance(0.0)
        keep_even_part(wake.flow)
        now = _drag(wake.sample())
        velocity_rate = float(np.abs(wake.flow.velocities - before).max()) / period
        drag_rate = abs(now - drag) / period
        before[:], drag = wake.flow.velocities, now
        progress(wake.t, max(velocity_rate, drag_rate))
        if max(velocity_rate, drag_rate) < tolerance:
            break
    else:
        raise PlantError(
            f"the symmetric wake is not steady after {longest:g} t_c: max |du/dt| = {velocity_rate:.2g}, "
            f"|dCd/dt| = {drag_rate:.2g}, must be below {tolerance:g}"
        )
    time = wake.t
    state = State(flat=wake.flow.flat.copy(), substep=0, action=0.0)
    return SteadyWake(
        state=state,
        sample=wake.reset(state),
        recirculation_length=recirculation_length(wake.grid, wake.flow),
        velocity_rate=velocity_rate,
        drag_rate=drag_rate,
        time=time,
    )


def write_steady(
    output: Path,
    flow: FlowConfig,
    json_file: Path | None,
    on: date,
    show: Callable[[dict[str, Any]], None] = lambda state: None,
) -> SteadyWake:
    """Settle a wake and write its state, and if wanted its figures as a results file.

    Args:
        output: state file.
        flow: flow settings.
        json_file: results file; None for none.
        on: the day for it.
        show: called after every control period with what a progress bar needs; rates fall by decades.
    """
    wake, decades = TruckWake(flow), -log10(TOLERANCE)

    def progress(t: float, rate: float) -> None:
        done = min(decades, max(0.0, -log10(rate)))
        show({"total": decades, "completed": round(done, 2), "note": f"t {t:.0f}  max |d/dt| {rate:.1e}"})

    found = settle(wake, progress=progress)
    save_state(output, wake)
    if json_file is not None:
        facts = {
            "config": asdict(flow),
            "grid": list(wake.grid.shape),
            "versions": versions("numpy", "numba", "scipy"),
        }
        write_result(json_file, figures=found.figures(), facts=facts, on=on)
    return found


def _drag(sample: Sample) -> float:
    return sample.Cd + sample.Cd_slot


def keep_even_part(flow: Flow) -> None:
    """Remove from the flow, in place, what is not its own mirror image in y."""
    flow.u[:] = 0.5 * (flow.u + flow.u[:, ::-1])
    flow.v[:] = 0.5 * (flow.v - flow.v[:, ::-1])
    flow.p[:] = 0.5 * (flow.p + flow.p[:, ::-1])
