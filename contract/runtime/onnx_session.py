"""A release's controller, computed by ONNX Runtime on one thread: in the ECU, the export's gates and benchmarks."""

from typing import Any, Final

import numpy as np
import onnxruntime

from contract.arrays import Array
from contract.controller.interface import OUTPUTS, ControllerError, ControlStep, Sizes
from contract.printable import shown
from contract.release.checks import CONTROLLER, Bundle
from contract.runtime.bounded_session import BoundedGraph

WARM_UP_LIMIT_S: Final = 10.0
"""Longest time for all steps of a warm-up, in s. The paper's controller takes some milliseconds per step, and its
deadline is 20 ms. A graph that takes a thousand times longer either never ends or is no controller."""


class OnnxController:
    """A controller that runs `controller.onnx`. Raises BundleControllerError if the model does not load or its shapes
    contradict the sizes. A copy has its own session. `description` states for people which program computes the step.
    """

    def __init__(self, model: bytes, sizes: Sizes) -> None:
        self._made_of = model, sizes
        self._graph = _graph(model, sizes)
        self._session = self._graph.session()
        self._defaults = {item.name for item in self._session.get_overridable_initializers()}
        self.description = f"ONNX Runtime {onnxruntime.__version__}"

    @classmethod
    def of(cls, bundle: Bundle) -> "OnnxController":
        """Open a bundle's controller. Raises BundleControllerError if it does not load or does not fit the manifest.

        The model may come from anyone, so one step first runs with bounded time and memory.
        """
        model, sizes = bundle.files[CONTROLLER], bundle.manifest.sizes
        _graph(model, sizes).tried(WARM_UP_LIMIT_S)
        controller = cls(model, sizes)
        controller.description += f", {bundle.manifest.precision}"
        return controller

    def __reduce__(self) -> tuple[Any, ...]:
        return OnnxController, self._made_of, {"description": self.description}

    def warm_up(self, steps: int, limit_s: float = WARM_UP_LIMIT_S) -> None:
        """Run steps on zeros, so that the first real step does not include ONNX Runtime's first allocations. Raises
        BundleControllerError if the steps exceed the time limit, fail, or give numbers that are not finite."""
        self._graph.run_on_zeros(self._session, steps, limit_s)

    def control_step(
        self,
        window: Array,
        plan: Array,
        free: Array,
        weights: Array | None = None,
        speed: float = 1.0,
        limit: float | None = None,
    ) -> ControlStep:
        """Compute one control step in float32 (`contract.controller.interface`); raises ControllerError if it fails."""
        feeds = {"window": window, "plan": plan, "free": free}
        for name, value in (("weights", weights), ("speed", speed), ("limit", limit)):
            if value is not None and name in self._defaults:
                feeds[name] = np.asarray(value)
        try:
            outputs = self._session.run(
                list(OUTPUTS), {name: value.astype(np.float32) for name, value in feeds.items()}
            )
        except Exception as error:
            raise ControllerError(f"{CONTROLLER} failed: {shown(error)}") from error
        new_plan, forces, terms, cost = (np.asarray(value, dtype=np.float64) for value in outputs)
        return ControlStep(plan=new_plan, forces=forces, terms=terms, cost=float(cost))


def _graph(model: bytes, sizes: Sizes) -> BoundedGraph:
    shapes = sizes.shapes()
    feeds = {name: np.zeros(shapes[name], dtype=np.float32) for name in ("window", "plan", "free")}
    lacking = ("speed", "limit")
    return BoundedGraph(name=CONTROLLER, model=model, shapes=shapes, feeds=feeds, outputs=OUTPUTS, optional=lacking)
