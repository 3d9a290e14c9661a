"""A release's controller as ONNX Runtime computes it, on one thread: in the ECU, the export's gates and benchmarks."""

from typing import Any

import numpy as np
import onnxruntime

from contract.arrays import Array
from contract.controller.interface import OUTPUTS, ControllerError, ControlStep, Sizes
from contract.errors import BundleError
from contract.release.bundle import CONTROLLER, Bundle


class OnnxController:
    """Runs `controller.onnx`.

    Args:
        model: the file's content.
        sizes: that it must have.

    Attributes:
        description: what computes the step, for people.

    Raises:
        BundleError: if the model does not load or its shapes contradict the sizes.
    """

    def __init__(self, model: bytes, sizes: Sizes) -> None:
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        # The optional `weights` input, an initialiser that may be overridden, is warned about at every load.
        options.log_severity_level = 3
        try:
            self._session: Any = onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
        except Exception as error:
            raise BundleError(f"{CONTROLLER} does not load: {error}") from error
        self._sizes = sizes
        found = {item.name: item.shape for item in (*self._session.get_inputs(), *self._session.get_outputs())}
        # ONNX Runtime lists inputs that have a default apart.
        found |= {item.name: item.shape for item in self._session.get_overridable_initializers()}
        for name, shape in sizes.shapes().items():
            if found.get(name) != list(shape):
                raise BundleError(f"{CONTROLLER}: {name!r} has shape {found.get(name)}, must have {list(shape)}")
        self.description = f"ONNX Runtime {onnxruntime.__version__}"

    @classmethod
    def of(cls, bundle: Bundle) -> "OnnxController":
        """A bundle's; raises BundleError if its model does not load or contradicts the manifest."""
        controller = cls(bundle.files[CONTROLLER], Sizes.of(bundle.manifest))
        controller.description += f", {bundle.manifest.precision}"
        return controller

    def warm_up(self, steps: int) -> None:
        """Run on zeros, so that the first real step does not pay for ONNX Runtime's first allocations."""
        shapes = self._sizes.shapes()
        window, plan, free = (np.zeros(shapes[name]) for name in ("window", "plan", "free"))
        for _ in range(steps):
            self.control_step(window, plan, free)

    def control_step(self, window: Array, plan: Array, free: Array, weights: Array | None = None) -> ControlStep:
        """One control step in float32 (`contract.controller.interface`); raises ControllerError if it fails."""
        feeds = {"window": window, "plan": plan, "free": free} | ({} if weights is None else {"weights": weights})
        try:
            outputs = self._session.run(
                list(OUTPUTS), {name: value.astype(np.float32) for name, value in feeds.items()}
            )
        except Exception as error:
            raise ControllerError(f"{CONTROLLER} failed: {error}") from error
        new_plan, forces, terms, cost = (np.asarray(value, dtype=np.float64) for value in outputs)
        return ControlStep(plan=new_plan, forces=forces, terms=terms, cost=float(cost))
