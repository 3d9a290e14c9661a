"""The execution of a bundle's graphs by ONNX Runtime on one thread, for the ECU, the export's checks and benchmarks.

Graphs may come from anyone, so a graph first runs once in bounded time and memory.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from threading import Timer
from time import perf_counter
from typing import Any, Final

import numpy as np
import onnxruntime

from contract.arrays import Array
from contract.controller.estimator import ESTIMATOR, ESTIMATOR_INPUT, ESTIMATOR_OUTPUT, estimator_shapes
from contract.controller.interface import OUTPUTS, ControllerError, ControlStep, Sizes
from contract.errors import BundleControllerError
from contract.printable import shown
from contract.release.checks import CONTROLLER, Bundle

MAX_MEMORY: Final = 256 * 2**20
"""Largest size, in bytes, of the values of all graphs in a process; the paper's controller needs one million bytes."""
WARM_UP_LIMIT_S: Final = 10.0
"""Longest time for all steps of a warm-up, in s. The paper's controller takes some milliseconds per step, and its
deadline is 20 ms. A graph that takes a thousand times longer either never ends or is no controller."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BoundedGraph:
    """A graph in a bundle, with the shapes of inputs and outputs that the graph must have, by name. `inputs` has the
    names of the inputs without a default, `optional` the names in `shapes` that the graph may lack."""

    name: str
    model: bytes
    shapes: Mapping[str, tuple[int, ...]]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    optional: tuple[str, ...] = ()

    def tried(self, limit_s: float) -> None:
        """Run one step of the graph in bounded time and memory. With optimisation, ONNX Runtime would compute constant
        expressions during loading, without bounds. Raises the errors of `session` and `run_on_zeros`."""
        options = _options()
        options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_DISABLE_ALL
        self.run_on_zeros(self.session(options), 1, limit_s)

    def run_on_zeros(self, session: Any, steps: int, limit_s: float) -> None:
        """Run steps on zeros. Raises BundleControllerError if a step fails, takes too long or gives NaN or infinity."""
        options = onnxruntime.RunOptions()
        # ONNX Runtime checks this flag between two nodes, also inside the bodies of loops.
        timer = Timer(limit_s, setattr, (options, "terminate", True))
        timer.daemon = True
        feeds = {name: np.zeros(self.shapes[name], dtype=np.float32) for name in self.inputs}
        began = perf_counter()
        done = 0
        timer.start()
        try:
            for _ in range(steps):
                answers = session.run(list(self.outputs), feeds, options)
                done += 1
                for name, value in zip(self.outputs, answers, strict=True):
                    if not np.isfinite(value).all():
                        raise BundleControllerError(f"{self.name}: {name!r} is not finite for a window of zeros")
        except BundleControllerError:
            raise
        except Exception as error:
            if options.terminate:
                raise BundleControllerError(
                    f"{self.name}: {done} of {steps} steps on zeros were done after {perf_counter() - began:.1f} s: "
                    f"all must be done in {limit_s:g} s"
                ) from error
            raise BundleControllerError(f"{self.name} failed on a window of zeros: {shown(error)}") from error
        finally:
            timer.cancel()

    def session(self, options: Any = None) -> Any:
        """Open an ONNX Runtime session. Raises BundleControllerError if the graph does not load or has wrong shapes."""
        try:
            session = onnxruntime.InferenceSession(
                self.model, options or _options(), providers=["CPUExecutionProvider"], enable_fallback=False
            )
            # ONNX Runtime lists inputs with a default separately. Reading a name fails if the name is no valid text.
            listed = (*session.get_inputs(), *session.get_outputs(), *session.get_overridable_initializers())
            found = {item.name: item.shape for item in listed}
        except Exception as error:
            raise BundleControllerError(f"{self.name} does not load: {shown(error)}") from error
        for name, shape in self.shapes.items():
            if found.get(name) != list(shape) and not (name in self.optional and name not in found):
                wrong = f"{name!r} has shape {found.get(name)}, must have {list(shape)}"
                raise BundleControllerError(f"{self.name}: {wrong}")
        return session


def _options() -> Any:
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    # Errors are raised as exceptions and need not be printed. Without this line, loading a graph would print a warning
    # about the optional input `weights`, an initialiser that may be overridden.
    options.log_severity_level = 4
    # The graph's bytes were checked for external constants. If the graph nevertheless refers to a file, ONNX Runtime
    # looks for this file below a path that is no folder, and finds nothing.
    options.add_session_config_entry("session.model_external_initializers_file_folder_path", os.devnull)
    options.add_session_config_entry("session.load_model_format", "ONNX")
    # Sessions use the bounded allocator, because a graph may need more memory during control than for zeros.
    _register_bounded_memory()
    options.add_session_config_entry("session.use_env_allocators", "1")
    return options


@cache
def _register_bounded_memory() -> None:
    """Register an allocator of bounded size that sessions can use; ONNX Runtime accepts one allocator per process."""
    onnxruntime.create_and_register_allocator(
        onnxruntime.OrtMemoryInfo(
            "Cpu", onnxruntime.OrtAllocatorType.ORT_ARENA_ALLOCATOR, 0, onnxruntime.OrtMemType.DEFAULT
        ),
        onnxruntime.OrtArenaCfg({"max_mem": MAX_MEMORY, "arena_extend_strategy": 0}),
    )


class OnnxController:
    """A controller that runs `controller.onnx`. Raises BundleControllerError if the model does not load or its shapes
    contradict the sizes. A copy has its own session. `description` names the program that computes the step."""

    def __init__(self, model: bytes, sizes: Sizes) -> None:
        self._made_of = model, sizes
        self._graph = _graph(model, sizes)
        self._session = self._graph.session()
        self._defaults = {item.name for item in self._session.get_overridable_initializers()}
        self.description = f"ONNX Runtime {onnxruntime.__version__}"

    @classmethod
    def of(cls, bundle: Bundle) -> "OnnxController":
        """Run one step of a bundle's controller in bounded time and memory, then open the controller. Raises
        BundleControllerError if the controller does not load or does not fit the manifest."""
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
        """Compute one control step in float32 (`contract.controller.interface`). Raises ControllerError on failure."""
        feeds = {"window": window, "plan": plan, "free": free}
        for name, value in (("weights", weights), ("speed", speed), ("limit", limit)):
            if value is not None and name in self._defaults:
                feeds[name] = np.asarray(value)
        try:
            values = {name: value.astype(np.float32) for name, value in feeds.items()}
            outputs = self._session.run(list(OUTPUTS), values)
        except Exception as error:
            raise ControllerError(f"{CONTROLLER} failed: {shown(error)}") from error
        new_plan, forces, terms, cost = (np.asarray(value, dtype=np.float64) for value in outputs)
        return ControlStep(plan=new_plan, forces=forces, terms=terms, cost=float(cost))


def _graph(model: bytes, sizes: Sizes) -> BoundedGraph:
    shapes, inputs, optional = sizes.shapes(), ("window", "plan", "free"), ("speed", "limit")
    return BoundedGraph(name=CONTROLLER, model=model, shapes=shapes, inputs=inputs, outputs=OUTPUTS, optional=optional)


class OnnxEstimator:
    """An estimator that runs `sensors.onnx`. Raises BundleControllerError if the model does not load, its shapes
    contradict the sizes, or a step on zeros does not end in time. The horizon in `sizes` is not used."""

    def __init__(self, model: bytes, sizes: Sizes) -> None:
        self._made_of = model, sizes
        shapes = estimator_shapes(sizes.window, sizes.sensors)
        inputs, outputs = (ESTIMATOR_INPUT,), (ESTIMATOR_OUTPUT,)
        graph = BoundedGraph(name=ESTIMATOR, model=model, shapes=shapes, inputs=inputs, outputs=outputs)
        graph.tried(WARM_UP_LIMIT_S)
        self._session = graph.session()
        graph.run_on_zeros(self._session, 3, WARM_UP_LIMIT_S)
        self._shape = shapes[ESTIMATOR_OUTPUT]

    def __reduce__(self) -> tuple[Any, ...]:
        return OnnxEstimator, self._made_of

    @classmethod
    def of(cls, bundle: Bundle) -> "OnnxEstimator | None":
        """Open a bundle's estimator; return None if the bundle has no estimator. Raises the errors of the class."""
        model = bundle.files.get(ESTIMATOR)
        return None if model is None else cls(model, bundle.manifest.sizes)

    def estimates(self, window: Array) -> Array:
        """Return estimates (V, S) in Cp for a window (L, S+1). Raises ControllerError if an estimate is not finite."""
        try:
            (values,) = self._session.run([ESTIMATOR_OUTPUT], {ESTIMATOR_INPUT: window.astype(np.float32)})
        except Exception as error:
            raise ControllerError(f"{ESTIMATOR} failed: {shown(error)}") from error
        if not np.isfinite(values).all():
            raise ControllerError(f"{ESTIMATOR}: an estimate is not finite")
        return np.asarray(values, dtype=np.float64)
