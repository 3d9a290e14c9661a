"""A body's wake with its tape as the refinement takes it (`train.refinement.flow`)."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from math import ceil
from pathlib import Path
from typing import Final

import numpy as np

from contract.arrays import Array, Index
from contract.config.body import TRUCK_BODY
from contract.config.body_sensors import layout_of
from contract.config.tree import Config
from contract.runtime.copies import CopiedWhole
from firmware_sim.campaign.starts import phases_apart
from train.refinement.flow import FlowState, Seen
from wake.solver.grid import box_grid
from wake.truck.develop import develop
from wake.truck.regrid import SETTLE_TIME, moved
from wake.truck.state import State, check_body, check_grid, check_reynolds, developed_state, load_state
from wake.truck.tape import Tape, no_weights
from wake.truck.truck_wake import TruckWake

MEMORY_MB: Final = 7000.0
"""Bound of the tape, in 10^6 bytes: 125 control periods take 2000 on the mesh of the refinement, 6900 on the default
one; beyond it the tape computes again."""
AT_REST: Final = 60.0
"""Convective times in which the wake without jets settles at a speed, and as long an average: twelve cycles."""


class DifferentiableWake(CopiedWhole):
    """A plant at the beginning of control periods, with the differences of some of its sensors. `columns` (2 p,) are
    those of the sensors among the plant's, in pairs."""

    def __init__(self, plant: TruckWake, columns: Index) -> None:
        self.plant, self._columns = plant, columns
        self._tape, self._config = Tape(plant, MEMORY_MB), plant.config
        self._speeds = np.ones(1)

    def begin(self, state: FlowState, speeds: Array) -> Seen:
        """Go on from there with an empty tape, at speeds (n + 1,) in design speeds; a faster one takes more steps."""
        plant, config = self.plant, self._config
        plant.config = replace(config, substeps=ceil(config.substeps * max(1.0, float(speeds.max()))))
        times, faster = config.control_period * np.arange(len(speeds), dtype=np.float64), speeds - 1.0
        plant.wind = partial(_between, times=times, values=faster) if faster.any() else None
        plant.reset(State(flat=state.flat, substep=0, action=state.action))
        self._speeds = speeds
        self._tape.restart()
        return self._seen()

    def advance(self, action: float) -> Seen:
        """A control period, kept for the way back; raises PlantError as `Tape.advance`."""
        self._tape.advance(action)
        return self._seen()

    def back(self, weights: Seen) -> float:
        """Go back by a period; the sensitivity to the action commanded in it."""
        speed = self._speed
        whole = no_weights(len(self.plant.layout))
        whole.Cp[self._columns] = weights.Cp / speed**2
        Cd, Cl = weights.Cd / speed**2, weights.Cl / speed**2
        return self._tape.back(replace(whole, Cd=Cd, Cl=Cl, Uy_probe=weights.Uy / speed))

    def state(self) -> FlowState:
        """Where the flow is."""
        return FlowState(flat=self.plant.flow.flat.copy(), action=self.plant.action)

    def at_rest(self, state: FlowState, speed: float, over: float = AT_REST) -> tuple[float, float] | None:
        """Means of base pressure and of the differences' magnitude without jets; None without a sensor on the base.

        Args:
            over: for which the wake settles, and then is averaged, in convective times of the speed.
        """
        on_base = np.isin(self._columns, self.plant.layout.base)
        if not on_base.any():
            return None
        periods = round(over / speed / self._config.control_period)
        plant = TruckWake(self._config, body=self.plant.body, precision=self.plant.solver.precision)
        plant.config = replace(self._config, substeps=ceil(self._config.substeps * max(1.0, speed)))
        plant.reset(State(flat=state.flat, substep=0, action=0.0))
        plant.scale(speed)
        plant.wind = lambda t: speed - 1.0
        for _ in range(periods):
            plant.advance(0.0)
        rows = np.array([plant.advance(0.0).Cp[self._columns] for _ in range(periods)]) / speed**2
        return float(rows[:, on_base].mean()), float(np.abs(rows[:, ::2] - rows[:, 1::2]).mean())

    @property
    def _speed(self) -> float:
        """The speed at the sample that the tape ends with."""
        return float(self._speeds[len(self._tape)])

    def _seen(self) -> Seen:
        sample, speed = self.plant.sample(), self._speed
        q = speed**2
        return Seen(Cp=sample.Cp[self._columns] / q, Cd=sample.Cd / q, Cl=sample.Cl / q, Uy=sample.Uy_probe / speed)


def _between(t: float, *, times: Array, values: Array) -> float:
    return float(np.interp(t, times, values))


def differentiable_wake(
    config: Config, sensors: Sequence[str], start: Path | None, progress: Callable[[float, float], None]
) -> tuple[DifferentiableWake, list[FlowState]]:
    """The plant of a refinement on its mesh, and developed wakes in as many phases as it has streams. Raises PlantError
    if the start is of another body, Reynolds number or mesh, or the flow diverges.

    Args:
        start: a developed wake on the default mesh; None takes the truck's shipped one, and around another body lets
            one develop from rest.
        progress: called with (time, duration) while the wake settles on the mesh.
    """
    wake = wake_of(config, sensors)
    plant = wake.plant
    _develop(plant, start, progress)
    starts = list[FlowState]()
    reached = 0
    for apart in phases_apart(config.refine.streams, config):
        for _ in range(apart - reached):
            plant.advance(0.0)
        reached = apart
        starts.append(wake.state())
    return wake, starts


def _develop(plant: TruckWake, start: Path | None, progress: Callable[[float, float], None]) -> None:
    """Leave the plant in a developed wake."""
    if start is None and plant.body != TRUCK_BODY:
        develop(plant, progress=progress)
        return
    state, source = developed_state() if start is None else load_state(start), box_grid(plant.body.length)
    if state.origin is not None:
        check_body(state.origin, plant.body)
        check_reynolds(state.origin, plant.config.reynolds)
        check_grid(state.origin, source.shape)
    moved(state, source, plant, SETTLE_TIME, progress)


def wake_of(config: Config, sensors: Sequence[str]) -> DifferentiableWake:
    """The plant of a refinement on its mesh, at rest."""
    precision = np.float32 if config.refine.single_precision else np.float64
    plant = TruckWake(mesh_of(config).flow, body=config.body, precision=precision)
    return DifferentiableWake(plant, layout_of(config.body).indices(sensors))


def mesh_of(config: Config) -> Config:
    """The settings with the mesh of the refinement."""
    flow = replace(config.flow, refinement=config.refine.refinement, substeps=config.refine.substeps)
    return replace(config, flow=flow)
