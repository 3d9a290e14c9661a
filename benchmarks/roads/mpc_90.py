"""MPC of the release's kind that reads every sensor: the model's teacher encoder and its wide dynamics and decoder.

What four sensors, int8 and narrow networks cost in the loop is the difference between this row and the release's.
"""

import numpy as np

from benchmarks.common.command_line import MODEL
from benchmarks.roads.loop import Law, Setting, controller_law, plant_outcome
from benchmarks.roads.release import recorded_periods
from benchmarks.roads.row import Outcome, Row
from contract.arrays import Array
from contract.controller.interface import ControlStep, Sizes
from contract.model import model_folder
from contract.model.model_folder import TEACHER
from contract.release import bundle as bundles
from contract.shipped import BUNDLE
from export.program.controller_program import ControllerProgram
from export.reference.mpc import control_step
from wake.plant.sample import Sample
from wake.truck.state import State


class Reference:
    """A controller program in NumPy, float64."""

    def __init__(self, program: ControllerProgram) -> None:
        self.description = "NumPy, float64"
        self._program = program

    def warm_up(self, steps: int) -> None:
        """Nothing happens once."""

    def control_step(self, window: Array, plan: Array, free: Array, weights: Array | None = None) -> ControlStep:
        """As the interface's."""
        return control_step(self._program, window, plan, free, weights)


class Windowed:
    """A law on the plant itself: it keeps the window of all pressures that an ECU would.

    Args:
        length, sensors: of the window.
    """

    def __init__(self, law: Law, *, length: int, sensors: int) -> None:
        self._law, self._window = law, np.zeros((length, sensors + 1))

    def see(self, sample: Sample) -> None:
        """A row more."""
        self._window = np.vstack([self._window[1:], np.append(sample.Cp, sample.action)])

    def command(self, committed: float) -> float:
        return self._law(self._window, committed)


def measure(road: str, setting: Setting) -> Row:
    """Its row."""
    trained, release = model_folder.read(MODEL), bundles.load(BUNDLE)
    about = trained.description
    program = ControllerProgram.from_state(
        encoder=trained.network(TEACHER),
        dynamics=trained.network("dynamics"),
        decoder=trained.network("decoder"),
        scaling=about.scaling,
        mpc=release.manifest.mpc,
        action_limit=about.config.flow.action_limit,
        sensors=about.layout.names,
        window=about.config.model.window,
    )
    reference = Reference(program)
    sizes = Sizes(window=program.window, sensors=len(about.layout), horizon=program.mpc.horizon)

    def run(start: State) -> Outcome:
        law = controller_law(reference, sizes.horizon)
        return plant_outcome(setting.config, start, Windowed(law, length=sizes.window, sensors=sizes.sensors))

    return Row(
        road=road,
        title="MPC of the release's kind, every sensor",
        kind="learned",
        outcomes=setting.outcomes(run),
        sensors=sizes.sensors,
        loop="plant",
        mesh=setting.mesh,
        interactions=recorded_periods(),
        note="the release's teacher: wide networks in NumPy's float64, its weights of the cost",
    )
