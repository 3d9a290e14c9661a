"""A release's controller as a policy: the ECU's window and warm start, without bus, latency or fail-safe."""

import numpy as np
import numpy.typing as npt

from contract import sensors
from contract.config.tree import FlowConfig
from contract.controller.interface import Controller, ControllerError
from contract.controller.onnx_session import OnnxController
from contract.errors import BundleError
from contract.release.bundle import Bundle

Array = npt.NDArray[np.float64]


def check_flow(bundle: Bundle, flow: FlowConfig) -> None:
    """Raises BundleError if the controller was built for another control period or action limit."""
    for field, name in (("control_period", "control period"), ("action_limit", "action limit")):
        built_for, here = getattr(bundle.manifest, field), getattr(flow, field)
        if built_for != here:
            raise BundleError(
                f"bundle {bundle.manifest.name!r} was built for another {name}: {built_for}, the flow has {here}"
            )


class BundlePolicy:
    """Follows `wake.recording.feedback.Policy`: zero until the window is full, then the first action of each plan.

    The memory holds the number of rows seen, the window of rows (Cp_k, a_{k-1}), and the last plan as it came out:
    the graph shifts it, so that its first action, the one that exploration changed, is not used again.

    Args:
        bundle: verified release.
        controller: what runs its `controller.onnx`; default: ONNX Runtime on one thread.

    Raises:
        BundleError: if the model does not load.
    """

    def __init__(self, bundle: Bundle, controller: Controller | None = None) -> None:
        manifest = bundle.manifest
        self._columns = sensors.indices(manifest.sensors)
        self._shape = (manifest.window, len(manifest.sensors) + 1)
        self._free = np.ones(manifest.mpc.horizon)
        self._controller = OnnxController.of(bundle) if controller is None else controller

    def start(self) -> Array:
        """No rows, a plan of zeros."""
        return np.zeros(1 + self._shape[0] * self._shape[1] + len(self._free))

    def step(self, memory: Array, Cp: Array, action: float) -> tuple[float, Array]:
        """The command and the memory after it.

        Raises:
            ControllerError: if the controller fails or its plan is not finite.
        """
        rows, plan = memory[0] + 1.0, memory[-len(self._free) :]
        old = memory[1 : -len(self._free)].reshape(self._shape)
        window = np.vstack([old[1:], np.append(Cp[self._columns], action)])
        command = 0.0
        if rows >= self._shape[0]:
            plan = self._controller.control_step(window, plan, self._free).plan
            if not np.isfinite(plan).all():
                raise ControllerError("the controller's plan is not finite")
            command = float(plan[0])
        return command, np.concatenate([[rows], window.ravel(), plan])
