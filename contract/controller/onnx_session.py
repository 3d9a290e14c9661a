"""The controller of a release bundle, run by ONNX Runtime on one thread."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt
import onnxruntime

from contract.errors import BundleError, StillwakeError
from contract.release.bundle import CONTROLLER, Bundle

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class ControlStep:
    """What one control step yields; see `contract.release.bundle` for the meaning of each.

    Attributes:
        plan: actions a_t .. a_{t+H-1}, (H,).
        forces: predicted (Cd, Cl) at t+1 .. t+H, (H, 2).
        cost: J of the plan.
    """

    plan: Array
    forces: Array
    cost: float


class ControllerError(StillwakeError):
    """The controller could not compute its step; the ECU latches a fault."""


class Controller(Protocol):
    """What the ECU needs of a controller."""

    def control_step(self, window: Array, plan: Array, free: Array) -> ControlStep:
        """One control step from a window (L, S+1), the previous plan (H,) and the mask of free actions (H,).

        Raises:
            ControllerError: if there is no answer.
        """


class RunnableController(Controller, Protocol):
    """A controller on this machine: one that can say what computes it and be made ready before a run.

    Attributes:
        description: what computes the step, for people.
    """

    description: str

    def warm_up(self, steps: int) -> None:
        """Run on zeros, so that the first real step does not pay for what happens once."""


class OnnxController:
    """Runs `controller.onnx`.

    Raises:
        BundleError: if the model does not load or its shapes contradict the manifest.
    """

    def __init__(self, bundle: Bundle) -> None:
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        # The optional `weights` input, an initialiser that may be overridden, is warned about at every load.
        options.log_severity_level = 3
        try:
            self._session = onnxruntime.InferenceSession(
                bundle.files[CONTROLLER], options, providers=["CPUExecutionProvider"]
            )
        except Exception as error:
            raise BundleError(f"{CONTROLLER} does not load: {error}") from error
        manifest = bundle.manifest
        self.description = f"ONNX Runtime {onnxruntime.__version__}, {manifest.precision}"
        horizon = manifest.mpc.horizon
        expected = {
            "window": [manifest.window, len(manifest.sensors) + 1],
            "plan": [horizon],
            "free": [horizon],
            "new_plan": [horizon],
            "forces": [horizon, 2],
            "cost": [],
        }
        found = {item.name: item.shape for item in (*self._session.get_inputs(), *self._session.get_outputs())}
        for name, shape in expected.items():
            if found.get(name) != shape:
                raise BundleError(f"{CONTROLLER}: {name!r} has shape {found.get(name)}, the manifest says {shape}")

    def warm_up(self, steps: int) -> None:
        """Run on zeros, so that the first real step does not pay for ONNX Runtime's first allocations."""
        shapes = {item.name: item.shape for item in self._session.get_inputs()}
        window, plan, free = (np.zeros(shapes[name]) for name in ("window", "plan", "free"))
        for _ in range(steps):
            self.control_step(window, plan, free)

    def control_step(self, window: Array, plan: Array, free: Array) -> ControlStep:
        feeds = {"window": window, "plan": plan, "free": free}
        try:
            new_plan, forces, cost = self._session.run(
                ["new_plan", "forces", "cost"], {name: value.astype(np.float32) for name, value in feeds.items()}
            )
        except Exception as error:
            raise ControllerError(f"{CONTROLLER} failed: {error}") from error
        return ControlStep(
            plan=np.asarray(new_plan, dtype=np.float64), forces=np.asarray(forces, dtype=np.float64), cost=float(cost)
        )
