"""The sensor estimator of a bundle, computed by ONNX Runtime on one thread: on the ECU and in benchmarks."""

from typing import Any, Final

import numpy as np

from contract.arrays import Array
from contract.controller.estimator import ESTIMATOR, ESTIMATOR_INPUT, ESTIMATOR_OUTPUT, estimator_shapes
from contract.controller.interface import ControllerError, Sizes
from contract.printable import shown
from contract.release.checks import Bundle
from contract.runtime.bounded_session import BoundedGraph
from contract.runtime.onnx_session import WARM_UP_LIMIT_S

_WARM_UP_STEPS: Final = 3


class OnnxEstimator:
    """An estimator that runs `sensors.onnx`. Raises BundleControllerError if the model does not load, its shapes
    contradict the sizes, or a step on zeros does not end in time. The horizon in `sizes` is not used."""

    def __init__(self, model: bytes, sizes: Sizes) -> None:
        self._made_of = model, sizes
        shapes = estimator_shapes(sizes.window, sizes.sensors)
        feeds = {ESTIMATOR_INPUT: np.zeros(shapes[ESTIMATOR_INPUT], dtype=np.float32)}
        graph = BoundedGraph(name=ESTIMATOR, model=model, shapes=shapes, feeds=feeds, outputs=(ESTIMATOR_OUTPUT,))
        # The model may come from anyone, so it first runs with bounded time and memory.
        graph.tried(WARM_UP_LIMIT_S)
        self._session = graph.session()
        graph.run_on_zeros(self._session, _WARM_UP_STEPS, WARM_UP_LIMIT_S)
        self._shape = shapes[ESTIMATOR_OUTPUT]

    def __reduce__(self) -> tuple[Any, ...]:
        return OnnxEstimator, self._made_of

    @classmethod
    def of(cls, bundle: Bundle) -> "OnnxEstimator | None":
        """Open a bundle's estimator; None if the bundle has none. Raises BundleControllerError as the class does."""
        model = bundle.files.get(ESTIMATOR)
        return None if model is None else cls(model, bundle.manifest.sizes)

    def estimates(self, window: Array) -> Array:
        """Return the estimates (V, S) in Cp for a window (L, S+1), with V views and S sensors; raises ControllerError
        unless they are finite."""
        try:
            (values,) = self._session.run([ESTIMATOR_OUTPUT], {ESTIMATOR_INPUT: window.astype(np.float32)})
        except Exception as error:
            raise ControllerError(f"{ESTIMATOR} failed: {shown(error)}") from error
        if not np.isfinite(values).all():
            raise ControllerError(f"{ESTIMATOR}: an estimate is not finite")
        found: Array = np.asarray(values, dtype=np.float64)
        return found
