"""One control step of a released controller: what goes in, what comes out, and what runs it.

Every lowering has this interface: `controller.onnx` in a release bundle by the names below, the C library by the
members of its structures. With L the window, S the sensors and H the horizon:

=========  ========  =====================================================================================
input      shape     meaning
=========  ========  =====================================================================================
window     (L, S+1)  oldest row first; row k is (Cp_k at the manifest's sensors, a_{k-1})
plan       (H,)      the previous step's plan, as it came out; the controller shifts it by one step
free       (H,)      1 where the optimiser may change the shifted plan, 0 where it is committed (delay)
weights    (8,)      cost weights in the order of `CostWeights`; optional, defaults to the manifest's
speed      ()        the vehicle's speed as a ratio to the design speed; optional, 1 by default
limit      ()        bound on |a| in U_inf W; optional, defaults to the manifest's, and is never above it
=========  ========  =====================================================================================

A graph whose plan does not depend on the speed has no such input. One of release 1.0.0 has no limit.

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
"""Cost terms in the order of every array of them."""
REFUSALS: Final = {1: "a number is not finite", 2: "this build, or the processor's mode, computes not as IEEE 754 does"}
"""What the C library's statuses mean, but for 0, an answer."""
FORCES: Final = 2
"""(Cd, Cl)."""


class ControllerError(StillwakeError):
    """The controller could not compute its step; the ECU latches a fault."""


@dataclass(frozen=True, kw_only=True)
class Sizes:
    """What the shapes of the interface follow from: L, S and H."""

    window: int
    sensors: int
    horizon: int

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """The shape of every input and output by its name."""
        inputs = ((self.window, self.sensors + 1), (self.horizon,), (self.horizon,), (len(TERMS),), (), ())
        outputs = ((self.horizon,), (self.horizon, FORCES), (len(TERMS),), ())
        return dict(zip(INPUTS + OUTPUTS, inputs + outputs, strict=True))


@dataclass(frozen=True, kw_only=True, eq=False)
class ControlStep:
    """Outcome of a control step.

    Attributes:
        plan: (H,) actions a_t .. a_{t+H-1} in U_inf W; the first one is commanded.
        forces: (H, 2) predicted (Cd, Cl) at t+1 .. t+H under the plan.
        terms: (8,) unweighted cost terms of the plan.
        cost: J of the plan.
    """

    plan: Array
    forces: Array
    terms: Array
    cost: float


class Controller(Protocol):
    """What computes control steps: all that the ECU and the gates of the export need."""

    def control_step(
        self,
        window: Array,
        plan: Array,
        free: Array,
        weights: Array | None = None,
        speed: float = 1.0,
        limit: float | None = None,
    ) -> ControlStep:
        """One control step; without weights or a limit the controller's own apply. Raises ControllerError if there is
        no answer."""


class RunnableController(Controller, Protocol):
    """A controller on this machine: it has a description and can be made ready before a run. `description` is what
    computes the step, for people."""

    description: str

    def warm_up(self, steps: int) -> None:
        """Run on zeros, so that the first real step does not pay for what happens once."""


class CompiledLibrary(Controller, Protocol):
    """A C library, compiled and loaded."""

    @property
    def workspace_bytes(self) -> int:
        """Scratch memory that a caller has to own."""


CompileLibrary = Callable[[Mapping[str, bytes], Sizes], CompiledLibrary]
"""(files by name, sizes) to the library on this machine; raises LibraryError. `ecu.in_c` has one, and the
command line hands it to `export`, which checks what it compiles without knowing a compiler."""
