"""The truck's wake with its tape, and the controller, as the refinement takes them (`train.refinement.flow`)."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from contract.arrays import Array, Index
from contract.config.body_sensors import layout_of
from contract.config.tree import Config
from contract.errors import ConfigError
from contract.model import model_folder
from contract.runtime.onnx_session import OnnxController
from export.program.from_training import program_of
from export.to_onnx.control_step import build_controller
from firmware_sim.campaign.starts import phases_apart
from train.refinement.flow import FlowState, Iterating, Seen
from wake.solver.grid import box_grid
from wake.truck.regrid import SETTLE_TIME, moved
from wake.truck.state import State, developed_state, load_state
from wake.truck.tape import Tape, no_weights
from wake.truck.truck_wake import TruckWake

MEMORY_MB: Final = 7000.0
"""Bound of the tape, in 10^6 bytes: 125 control periods take 2000 on the mesh of the refinement, 6900 on the default
one; beyond it the tape computes again."""


class DifferentiableWake:
    """A plant at the beginning of control periods, with the differences of some of its sensors.

    Args:
        columns: (2 p,) of the sensors among the plant's, in pairs.
    """

    def __init__(self, plant: TruckWake, columns: Index) -> None:
        self._plant, self._columns = plant, columns
        self._tape = Tape(plant, MEMORY_MB)

    def begin(self, state: FlowState) -> Seen:
        """Go on from there with an empty tape."""
        self._plant.reset(State(flat=state.flat, substep=0, action=state.action))
        self._tape.restart()
        return self._seen()

    def advance(self, action: float) -> Seen:
        """A control period, kept for the way back; raises PlantError as `Tape.advance`."""
        self._tape.advance(action)
        return self._seen()

    def back(self, weights: Seen) -> float:
        """Go back by a period; the sensitivity to the action commanded in it."""
        whole = no_weights(len(self._plant.layout))
        whole.Cp[self._columns] = weights.Cp
        return self._tape.back(replace(whole, Cd=weights.Cd, Cl=weights.Cl, Uy_probe=weights.Uy))

    def state(self) -> FlowState:
        """Where the flow is."""
        return FlowState(flat=self._plant.flow.flat.copy(), action=self._plant.action)

    def _seen(self) -> Seen:
        sample = self._plant.sample()
        return Seen(Cp=sample.Cp[self._columns], Cd=sample.Cd, Cl=sample.Cl, Uy=sample.Uy_probe)


def differentiable_wake(
    config: Config, sensors: Sequence[str], start: Path | None, progress: Callable[[float, float], None]
) -> tuple[DifferentiableWake, list[FlowState]]:
    """The plant of a refinement on its mesh, and developed wakes in as many phases as it has streams.

    Args:
        start: a developed wake on the default mesh; None takes the shipped one.
        progress: called with (time, duration) while the wake settles on the mesh.

    Raises:
        PlantError: the start is of another body or Reynolds number, or the flow diverges.
    """
    plant = TruckWake(mesh_of(config).flow, body=config.body)
    state = developed_state() if start is None else load_state(start)
    moved(state, box_grid(config.body.length), plant, SETTLE_TIME, progress)
    wake = DifferentiableWake(plant, layout_of(config.body).indices(sensors))
    starts = list[FlowState]()
    reached = 0
    for apart in phases_apart(config.refine.streams, config.flow.control_period):
        for _ in range(apart - reached):
            plant.advance(0.0)
        reached = apart
        starts.append(wake.state())
    return wake, starts


def mesh_of(config: Config) -> Config:
    """The settings with the mesh of the refinement."""
    flow = replace(config.flow, refinement=config.refine.refinement, substeps=config.refine.substeps)
    return replace(config, flow=flow)


@dataclass(frozen=True, kw_only=True, eq=False)
class ControlSteps:
    """The control step of an ONNX controller as the refinement takes it."""

    controller: OnnxController

    def plan(self, window: Array, plan: Array, free: Array) -> Array:
        """The plan (H,); raises ControllerError as the controller does."""
        return self.controller.control_step(window, plan, free, None).plan


def iterating(model: Path, config: Config) -> Iterating:
    """The iterations of a model folder's controller, under the settings, for a prior that changes.

    Raises:
        ConfigError: the model has no prior yet.
    """
    program = program_of(model_folder.read(model), config.mpc)
    prior = program.prior
    if prior is None:
        raise ConfigError(f"refine.iterations = true: {model} has no prior yet; refine it first without")

    def of(weights: Mapping[str, Array]) -> ControlSteps:
        made = replace(program, prior=replace(prior, hidden=weights["hidden"], output=weights["output"]))
        return ControlSteps(controller=OnnxController(build_controller(made).SerializeToString(), made.sizes))

    return Iterating(window=program.window, horizon=program.mpc.horizon, of=of)
