"""A release's controller as ONNX Runtime computes it, on one thread: in the ECU, the export's gates and benchmarks."""

import os
from functools import cache
from threading import Timer
from time import perf_counter
from typing import Any, Final

import numpy as np
import onnxruntime

from contract.arrays import Array
from contract.controller.interface import OUTPUTS, ControllerError, ControlStep, Sizes
from contract.errors import BundleControllerError
from contract.release.bundle import CONTROLLER, Bundle
from contract.release.printable import shown

WARM_UP_LIMIT_S: Final = 10.0
"""For all steps of a warm-up: the paper's controller takes some milliseconds a step, and its deadline is 20. A graph
that needs a thousand times as long never ends, or is no controller."""
MAX_MEMORY: Final = 256 * 2**20
"""Of a step's intermediate values, in bytes: the paper's controller needs one."""


class OnnxController:
    """Runs `controller.onnx`.

    Args:
        model: the file's content.
        sizes: that it must have.

    Attributes:
        description: what computes the step, for people.

    Raises:
        BundleControllerError: if the model does not load or its shapes contradict the sizes.
    """

    def __init__(self, model: bytes, sizes: Sizes) -> None:
        self._session = _session(model, _options())
        self._sizes = sizes
        _check_shapes(self._session, sizes)
        self.description = f"ONNX Runtime {onnxruntime.__version__}"

    @classmethod
    def of(cls, bundle: Bundle) -> "OnnxController":
        """A bundle's; raises BundleControllerError if its model does not load or contradicts the manifest.

        The model may be anyone's, so it first shows that a step of it ends, and in little memory.
        """
        model, sizes = bundle.files[CONTROLLER], Sizes.of(bundle.manifest)
        _try(model, sizes)
        controller = cls(model, sizes)
        controller.description += f", {bundle.manifest.precision}"
        return controller

    def warm_up(self, steps: int, limit_s: float = WARM_UP_LIMIT_S) -> None:
        """Run on zeros, so that the first real step does not pay for ONNX Runtime's first allocations.

        Args:
            limit_s: wall-clock time for all steps.

        Raises:
            BundleControllerError: they take longer, fail, or answer with numbers that are not finite.
        """
        _run_on_zeros(self._session, self._sizes, steps, limit_s)

    def control_step(self, window: Array, plan: Array, free: Array, weights: Array | None = None) -> ControlStep:
        """One control step in float32 (`contract.controller.interface`); raises ControllerError if it fails."""
        feeds = {"window": window, "plan": plan, "free": free} | ({} if weights is None else {"weights": weights})
        try:
            outputs = self._session.run(
                list(OUTPUTS), {name: value.astype(np.float32) for name, value in feeds.items()}
            )
        except Exception as error:
            raise ControllerError(f"{CONTROLLER} failed: {shown(error)}") from error
        new_plan, forces, terms, cost = (np.asarray(value, dtype=np.float64) for value in outputs)
        return ControlStep(plan=new_plan, forces=forces, terms=terms, cost=float(cost))


def _options() -> Any:
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    # Errors are raised, and need not be printed too; the optional `weights` input, an initialiser that may be
    # overridden, would be warned about at every load.
    options.log_severity_level = 4
    # A graph from a bundle was judged to hold all its constants. Should one name a file all the same, it is looked for
    # below what is no folder, and not where the process happens to stand.
    options.add_session_config_entry("session.model_external_initializers_file_folder_path", os.devnull)
    return options


def _session(model: bytes, options: Any) -> Any:
    try:
        return onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
    except Exception as error:
        raise BundleControllerError(f"{CONTROLLER} does not load: {shown(error)}") from error


def _check_shapes(session: Any, sizes: Sizes) -> None:
    found = {item.name: item.shape for item in (*session.get_inputs(), *session.get_outputs())}
    # ONNX Runtime lists inputs that have a default apart.
    found |= {item.name: item.shape for item in session.get_overridable_initializers()}
    for name, shape in sizes.shapes().items():
        if found.get(name) != list(shape):
            raise BundleControllerError(f"{CONTROLLER}: {name!r} has shape {found.get(name)}, must have {list(shape)}")


def _try(model: bytes, sizes: Sizes) -> None:
    """Run one step as the graph stands, in bounded time and memory.

    To optimise a graph, ONNX Runtime computes what depends on constants alone while it loads, and neither time nor
    memory of that can be bounded. A step that was not optimised computes the same and can be.
    """
    options = _options()
    options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_DISABLE_ALL
    _register_bounded_memory()
    options.add_session_config_entry("session.use_env_allocators", "1")
    session = _session(model, options)
    _check_shapes(session, sizes)
    _run_on_zeros(session, sizes, 1, WARM_UP_LIMIT_S)


@cache
def _register_bounded_memory() -> None:
    """Give the process memory of a bounded size that sessions may use; ONNX Runtime takes it once."""
    onnxruntime.create_and_register_allocator(
        onnxruntime.OrtMemoryInfo(
            "Cpu", onnxruntime.OrtAllocatorType.ORT_ARENA_ALLOCATOR, 0, onnxruntime.OrtMemType.DEFAULT
        ),
        onnxruntime.OrtArenaCfg({"max_mem": MAX_MEMORY, "arena_extend_strategy": 0}),
    )


def _run_on_zeros(session: Any, sizes: Sizes, steps: int, limit_s: float) -> None:
    """Raises BundleControllerError as `OnnxController.warm_up` does."""
    shapes = sizes.shapes()
    feeds = {name: np.zeros(shapes[name], dtype=np.float32) for name in ("window", "plan", "free")}
    options = onnxruntime.RunOptions()
    # ONNX Runtime asks between two nodes, also inside the bodies of loops, whether it is to stop.
    timer = Timer(limit_s, setattr, (options, "terminate", True))
    timer.daemon = True
    began = perf_counter()
    done = 0
    timer.start()
    try:
        for _ in range(steps):
            answers = session.run(list(OUTPUTS), feeds, options)
            done += 1
            for name, value in zip(OUTPUTS, answers, strict=True):
                if not np.isfinite(value).all():
                    raise BundleControllerError(f"{CONTROLLER}: {name!r} is not finite for a window of zeros")
    except BundleControllerError:
        raise
    except Exception as error:
        if options.terminate:
            raise BundleControllerError(
                f"{CONTROLLER}: {done} of {steps} steps on zeros were done after {perf_counter() - began:.1f} s: "
                f"at most {limit_s:g} s are given for all"
            ) from error
        raise BundleControllerError(f"{CONTROLLER} failed on a window of zeros: {shown(error)}") from error
    finally:
        timer.cancel()
