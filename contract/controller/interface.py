"""The control step of a released controller: its inputs, its outputs, and the classes that compute it.

A controller's ONNX graph and C library have this interface. In the graph, inputs and outputs have the names below; in
the library they are members of structures. L is the window's length, S the number of sensors and H the horizon:

=========  ========  =====================================================================================
input      shape     meaning
=========  ========  =====================================================================================
window     (L, S+1)  oldest row first; row k is (Cp_k at the manifest's sensors, a_{k-1})
plan       (H,)      the previous step's `new_plan`, unchanged; the controller shifts it by one step
free       (H,)      1 where the optimiser may change the shifted plan, 0 for actions that are already fixed
weights    (8,)      cost weights in the order of `CostWeights`; optional, by default the manifest's weights
speed      ()        the vehicle's speed as a ratio to the design speed; optional, 1 by default
limit      ()        bound on |a| in U_inf W; optional; its default and largest value is the manifest's limit
=========  ========  =====================================================================================

A graph whose plan does not depend on the speed has no input `speed`. A graph of release 1.0.0 has no input `limit`.

=========  ========  =====================================================================================
output     shape     meaning
=========  ========  =====================================================================================
new_plan   (H,)      optimised actions a_t .. a_{t+H-1}
forces     (H, 2)    predicted (Cd, Cl) at t+1 .. t+H under `new_plan`
terms      (8,)      unweighted cost terms of `new_plan`, in the order of the weights
cost       ()        J of `new_plan`
=========  ========  =====================================================================================
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Final, Protocol

from contract.arrays import Array
from contract.config.controller import CostWeights
from contract.errors import StillwakeError

INPUTS: Final = ("window", "plan", "free", "weights", "speed", "limit")
OUTPUTS: Final = ("new_plan", "forces", "terms", "cost")
TERMS: Final = tuple(item.name for item in fields(CostWeights))
"""Names of the cost terms. Every array of terms has this order."""
REFUSALS: Final = {1: "a number is not finite", 2: "this build, or the processor's mode, violates IEEE 754"}
"""Meanings of the C library's status codes, except 0, which means success."""
FORCES: Final = 2
"""Number of forces: Cd and Cl."""


class ControllerError(StillwakeError):
    """A controller's failure to compute a control step. The ECU then latches a fault."""


@dataclass(frozen=True, kw_only=True)
class Sizes:
    """The sizes from which the shapes of the interface follow: window L, number of sensors S and horizon H."""

    window: int
    sensors: int
    horizon: int

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Return the shape of every input and output by name."""
        inputs = ((self.window, self.sensors + 1), (self.horizon,), (self.horizon,), (len(TERMS),), (), ())
        outputs = ((self.horizon,), (self.horizon, FORCES), (len(TERMS),), ())
        return dict(zip(INPUTS + OUTPUTS, inputs + outputs, strict=True))


@dataclass(frozen=True, kw_only=True, eq=False)
class ControlStep:
    """The outputs in the module's table. The ECU commands the plan's first action for which the input `free` is 1."""

    plan: Array
    forces: Array
    terms: Array
    cost: float


class Controller(Protocol):
    """An object that computes control steps for the ECU and for the checks of the export."""

    def control_step(
        self,
        window: Array,
        plan: Array,
        free: Array,
        weights: Array | None = None,
        speed: float = 1.0,
        limit: float | None = None,
    ) -> ControlStep:
        """Compute a step, by default with the controller's own weights and limit; may raise ControllerError."""


class RunnableController(Controller, Protocol):
    """A controller that runs on this machine; `description` states which program computes the step."""

    description: str

    def warm_up(self, steps: int) -> None:
        """Run control steps on zeros, so that one-time work does not slow down the first real step."""


class CompiledLibrary(Controller, Protocol):
    """A C library that is compiled and loaded."""

    @property
    def workspace_bytes(self) -> int:
        """Size of the scratch memory that the caller has to provide."""

    def known_answer(self) -> tuple[float, float]:
        """Return the action and the cost that a build's self-test step must give. A build without fused multiply-add
        gives these numbers bit for bit. Raises ControllerError if the library has no expected results."""


CompileLibrary = Callable[[Mapping[str, bytes], Sizes], CompiledLibrary]
"""A function that compiles files for the given sizes into a library on this machine, or raises LibraryError. The
package `export` checks C code but has no compiler, so the command line passes such a function to it."""
