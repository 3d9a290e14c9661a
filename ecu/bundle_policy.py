"""A policy that runs a release's controller with the ECU's window and warm start, without bus and fail-safe."""

import numpy as np

from contract.arrays import Array
from contract.controller.interface import Controller
from contract.release.checks import Bundle
from contract.runtime.onnx_session import OnnxController
from contract.sensor_layout import SensorLayout
from contract.sensors import TRUCK
from ecu.controller_memory import ControllerMemory, DelayLine
from ecu.fit import check_sensors


class BundlePolicy:
    """A `wake.recording.episode_job.Policy`. Its action is zero until the window is full, then the first action of each
    plan. If exploration changes this action, the next plan is not affected: the graph shifts the plan by one step,
    which drops its first action. `layout` names the columns of `Cp`. Raises BundleError if the model does not load, or
    if a sensor that the model reads is missing on the plant or has another position there."""

    def __init__(self, bundle: Bundle, controller: Controller | None = None, layout: SensorLayout = TRUCK) -> None:
        manifest = bundle.manifest
        check_sensors(bundle, layout)
        self._columns = layout.indices(manifest.sensors)
        self._shape, self._horizon = (manifest.window, len(manifest.sensors) + 1), manifest.mpc.horizon
        self._weights = np.array(manifest.mpc.weights.as_tuple())
        self._controller = OnnxController.of(bundle) if controller is None else controller

    def start(self) -> Array:
        """Return a memory without rows and with a plan of zeros."""
        length, columns = self._shape
        return _packed(ControllerMemory.empty(length=length, sensors=columns - 1, horizon=self._horizon, delay=0))

    def step(self, memory: Array, Cp: Array, action: float) -> tuple[float, Array]:
        """Return command and new memory. Raises ControllerError if the controller fails or its answer is not finite."""
        window, plan = memory[1 : -self._horizon].reshape(self._shape), memory[-self._horizon :]
        sent = DelayLine((action,))
        before = ControllerMemory(window=window, rows=int(memory[0]), gap=0, plan=plan, under_way=sent)
        after = before.observed(Cp[self._columns])
        if not after.is_full:
            return 0.0, _packed(after)
        after, answer = after.planned(self._controller, self._weights)
        return float(answer.plan[0]), _packed(after)


def _packed(memory: ControllerMemory) -> Array:
    """Return a memory as a flat array: the number of rows, then the window, (L, S + 1), then the plan, (H,)."""
    return np.concatenate([[memory.rows], memory.window.ravel(), memory.plan])
