"""The plant: the wake of the truck, or of another box, with its jets, advanced one control period at a time.

Sample k holds pressures and forces at t_k; the jet then ramps linearly from the action in force to the newly commanded
action until t_{k+1}. If a command arrives late (`advance_to`), its ramp starts late but ends at t_{k+1}.
"""

from dataclasses import replace
from functools import partial

import numpy as np

from contract.arrays import Array, Precision
from contract.config.body import TRUCK_BODY, BodyConfig, layout_of
from contract.config.plant import FlowConfig
from contract.errors import PlantError
from contract.runtime.copies import CopiedWhole
from wake.plant.drive import Wind
from wake.plant.protocol import SteppedPlant
from wake.plant.sample import Sample
from wake.solver import boundary
from wake.solver.grid import Flow, box_grid
from wake.solver.navier_stokes import FlowSolver, check_step
from wake.truck.state import Origin, State, check_origin
from wake.truck.surface import Surface, signed_distance, slot_profile


class TruckWake(CopiedWhole, SteppedPlant):
    """The flow around the truck, or around another body. Raises ConfigError if the grid is too coarse for the slots;
    PlantError if the time step is too large for this grid.

    A copy is an independent plant that continues bit for bit like the original. If `wind` can be pickled, the same
    holds for a pickle. np.float32 as the flow's `precision` takes about half the time of np.float64; it is meant for
    training with gradients through the solver. Samples are float64.

    Attributes:
        layout: the sensors, in the order of a sample's Cp.
        wind: a function of time that returns by how much the wind exceeds U_inf; None if the wind is steady. States do
            not hold the wind.
    """

    def __init__(
        self, config: FlowConfig | None = None, *, body: BodyConfig = TRUCK_BODY, precision: Precision = np.float64
    ) -> None:
        self.config = FlowConfig() if config is None else config
        self.body, self.layout = body, layout_of(body)
        self.grid = box_grid(body.length, self.config.refinement)
        self.boundary = boundary.Boundary(self.grid, partial(signed_distance, body=body))
        self._profile = slot_profile(self.grid)
        self._check_step(self.config)
        self.solver = FlowSolver(
            self.grid, self.boundary, 1.0 / self.config.reynolds, slot_profile=self._profile, precision=precision
        )
        self.surface = self._surface()
        self.wind: Wind | None = None
        self.flow = Flow.zeros(self.grid.shape, precision)
        self._substep = 0
        self._action = 0.0

    @property
    def description(self) -> str:
        nx, ny = self.grid.shape
        return f"stillwake, {nx} x {ny} cells, dt 1/{1.0 / self.dt:g}"

    @property
    def action(self) -> float:
        """Jet flow rate in force, in U_inf W."""
        return self._action

    def reset(self, state: State) -> Sample:
        """Continue from a state, bit for bit. Raises PlantError if the body, grid, Reynolds number or clock of the
        state and the plant differ, or the state is not finite."""
        origin, config = state.origin, self.config
        check_origin(origin, self.body, config.reynolds, self.grid.shape)
        clock = None if origin is None or origin.substeps is None else (origin.control_period, origin.substeps)
        # A state at t = 0 can continue with any control period and any number of substeps.
        if state.substep and clock is not None and clock != (config.control_period, config.substeps):
            raise PlantError(
                f"flow state is at step {state.substep} of a clock with {clock[1]} substeps in "
                f"{clock[0]} t_c, this plant has {config.substeps} in {config.control_period}"
            )
        if state.flat.shape != self.flow.flat.shape:
            raise PlantError(f"flow state has {state.flat.size} values, this grid needs {self.flow.flat.size}")
        if not np.isfinite(state.flat).all():
            raise PlantError("flow state holds values that are not finite")
        if not abs(state.action) <= config.action_limit * (1.0 + 1e-12):
            raise PlantError(f"flow state has action {state.action}: must be within +-{config.action_limit}")
        self.flow.flat[:] = state.flat
        self._substep, self._action = state.substep, state.action
        return self.sample()

    def set_reynolds(self, reynolds: float) -> None:
        """Continue with the viscosity of another Reynolds number. Raises PlantError if dt is too large."""
        config = replace(self.config, reynolds=reynolds)
        self._check_step(config)
        self.config = config
        self.solver.set_viscosity(1.0 / reynolds)
        self.surface = self._surface()

    def scale(self, ratio: float) -> None:
        """Scale the flow to a stream of `ratio` times the present speed: velocities are multiplied by the ratio,
        pressures by its square. The viscosity does not change, so the scaled flow has to settle."""
        self.flow.velocities[:] *= ratio
        self.flow.p[:] *= ratio * ratio

    def state(self) -> State:
        """Return a copy of the state for a later `reset`."""
        return State(
            flat=self.flow.flat.copy(),
            substep=self._substep,
            action=self._action,
            origin=Origin(
                shape=self.grid.shape,
                reynolds=self.config.reynolds,
                control_period=self.config.control_period,
                substeps=self.config.substeps,
                body_length=self.body.length,
                leading_edge_radius=self.body.leading_edge_radius,
            ),
        )

    def advance_to(self, substep: int, action: float | None = None, *, starts: Array | None = None) -> None:
        """Advance within the present period to `substep` (1 .. substeps). With an action, the jet ramps so that it
        reaches the action at the period's end; without an action, its flow rate does not change. `starts` is as in
        `FlowSolver.run`. Raises PlantError if the substep is not later in this period, if the action is not finite or
        exceeds the bound, or if the flow diverges."""
        steps, reached, in_force = self._ramp(substep, action)
        ramp, wind = {"action_from": self._action, "action_to": reached}, self.wind_from(self.t)
        self.solver.run(self.flow, dt=self.dt, steps=steps, wind=wind, starts=starts, **ramp)
        self._substep += steps
        self._action = in_force

    def sample(self) -> Sample:
        return self.surface.measure(self.flow, t=self.t, action=self._action)

    def vorticity(self) -> Array:
        """Return dv/dx - du/dy in cell corners inside the domain, (nx - 1, ny - 1), in U_inf / W."""
        dvdx = np.diff(self.flow.faces_v[:, 1:-1], axis=0) / self.grid.dxc[1:-1, None]
        dudy = np.diff(self.flow.faces_u[1:-1], axis=1) / self.grid.dyc[None, 1:-1]
        return np.asarray(dvdx - dudy)

    def pressure(self) -> Array:
        """Return Cp in the cells, (nx, ny)."""
        return np.asarray(2.0 * self.flow.cells_p)

    def _check_step(self, config: FlowConfig) -> None:
        check_step(
            self.grid,
            self.boundary.fluid,
            1.0 / config.reynolds,
            jet_speed=config.action_limit * float(np.abs(self._profile).max()),
            period=config.control_period,
            substeps=config.substeps,
        )

    def _surface(self) -> Surface:
        nu = 1.0 / self.config.reynolds
        return Surface(self.grid, self.boundary, nu, self._profile, self.body, self.layout)

    def wind_from(self, t: float) -> Wind | None:
        """Return a function of the time since t that gives the wind's excess over U_inf; None if the wind is steady."""
        wind = self.wind
        return None if wind is None else lambda after: wind(t + after)
