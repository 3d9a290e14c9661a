"""Sessions of ONNX Runtime on one thread, for graphs of unknown origin. A graph first runs once in bounded time and
memory."""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from threading import Timer
from time import perf_counter
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import onnxruntime

from contract.errors import BundleControllerError
from contract.printable import shown

MAX_MEMORY: Final = 256 * 2**20
"""Largest size, in bytes, of the values of all graphs in a process; the paper's controller needs one million bytes."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BoundedGraph:
    """A graph in a bundle.

    Attributes:
        shapes: required shapes of inputs and outputs, by name.
        feeds: zeros for every input without a default.
        optional: names in `shapes` that the graph may lack.
    """

    name: str
    model: bytes
    shapes: Mapping[str, tuple[int, ...]]
    feeds: Mapping[str, npt.NDArray[np.float32]]
    outputs: tuple[str, ...]
    optional: tuple[str, ...] = ()

    def session(self) -> Any:
        """Open the session. Raises BundleControllerError if the graph does not load or has other shapes."""
        return self._opened(_options())

    def tried(self, limit_s: float) -> None:
        """Run one step of the graph without optimisation, in bounded time and memory.

        When ONNX Runtime optimises a graph, it computes constant expressions during loading. Neither the time nor the
        memory of this computation can be bounded. A step without optimisation does the same computation in bounded time
        and memory. Raises BundleControllerError as `session` and `run_on_zeros` do.
        """
        options = _options()
        options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_DISABLE_ALL
        self.run_on_zeros(self._opened(options), 1, limit_s)

    def run_on_zeros(self, session: Any, steps: int, limit_s: float) -> None:
        """Run steps on zeros; raises BundleControllerError if they take too long, fail or give non-finite numbers."""
        options = onnxruntime.RunOptions()
        # ONNX Runtime checks this flag between two nodes, also inside the bodies of loops.
        timer = Timer(limit_s, setattr, (options, "terminate", True))
        timer.daemon = True
        began = perf_counter()
        done = 0
        timer.start()
        try:
            for _ in range(steps):
                answers = session.run(list(self.outputs), dict(self.feeds), options)
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

    def _opened(self, options: Any) -> Any:
        try:
            session = onnxruntime.InferenceSession(
                self.model, options, providers=["CPUExecutionProvider"], enable_fallback=False
            )
            # ONNX Runtime lists inputs with a default separately. Reading a name fails if the name is no valid text.
            listed = (*session.get_inputs(), *session.get_outputs(), *session.get_overridable_initializers())
            found = {item.name: item.shape for item in listed}
        except Exception as error:
            raise BundleControllerError(f"{self.name} does not load: {shown(error)}") from error
        for name, shape in self.shapes.items():
            if found.get(name) != list(shape) and not (name in self.optional and name not in found):
                raise BundleControllerError(
                    f"{self.name}: {name!r} has shape {found.get(name)}, must have {list(shape)}"
                )
        return session


def _options() -> Any:
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    # Errors are raised as exceptions, so they need not be printed. Without this line, the optional input `weights`,
    # which is an initialiser that may be overridden, would cause a warning whenever the graph is loaded.
    options.log_severity_level = 4
    # The graph's bytes were checked for external constants. If the graph nevertheless refers to a file, the search
    # starts at a path that is no folder, and not in the working directory.
    options.add_session_config_entry("session.model_external_initializers_file_folder_path", os.devnull)
    options.add_session_config_entry("session.load_model_format", "ONNX")
    # Sessions get this allocator because the memory limit also applies during control, where a graph may need more
    # memory than for zeros.
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
