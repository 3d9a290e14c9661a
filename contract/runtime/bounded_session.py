"""Sessions of ONNX Runtime for graphs that may be anyone's: on one thread, and at first in bounded time and memory."""

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
"""Bytes that the values of all graphs in a process may take: the paper's controller needs one million."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BoundedGraph:
    """A graph in a bundle.

    Attributes:
        shapes: that its inputs and outputs must have, by name.
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
        """The session to compute with; raises BundleControllerError if it does not load or has other shapes."""
        return self._opened(_options())

    def tried(self, limit_s: float) -> None:
        """Run one step as the graph stands, in bounded time and memory.

        To optimise a graph, ONNX Runtime computes what depends on constants alone while it loads, and neither time nor
        memory of that can be bounded. A step that was not optimised computes the same and can be. Raises
        BundleControllerError as `session` and `run_on_zeros` do.
        """
        options = _options()
        options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_DISABLE_ALL
        self.run_on_zeros(self._opened(options), 1, limit_s)

    def run_on_zeros(self, session: Any, steps: int, limit_s: float) -> None:
        """So many steps; raises BundleControllerError if they take longer, fail, or answer with what is not finite."""
        options = onnxruntime.RunOptions()
        # ONNX Runtime asks between two nodes, also inside the bodies of loops, whether it is to stop.
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
                    f"at most {limit_s:g} s are given for all"
                ) from error
            raise BundleControllerError(f"{self.name} failed on a window of zeros: {shown(error)}") from error
        finally:
            timer.cancel()

    def _opened(self, options: Any) -> Any:
        try:
            session = onnxruntime.InferenceSession(
                self.model, options, providers=["CPUExecutionProvider"], enable_fallback=False
            )
            # ONNX Runtime lists inputs that have a default apart. A name may be no text.
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
    # Errors are raised, and need not be printed too; the optional `weights` input, an initialiser that may be
    # overridden, would be warned about at every load.
    options.log_severity_level = 4
    # A bundle's graph was judged to hold all its constants. Should one name a file all the same, it is searched below
    # what is no folder, and not where the process happens to stand.
    options.add_session_config_entry("session.model_external_initializers_file_folder_path", os.devnull)
    options.add_session_config_entry("session.load_model_format", "ONNX")
    # Also for the steps in control: what a graph takes on zeros is not what it takes on pressures.
    _register_bounded_memory()
    options.add_session_config_entry("session.use_env_allocators", "1")
    return options


@cache
def _register_bounded_memory() -> None:
    """Give the process memory of a bounded size that sessions may use; ONNX Runtime takes it once."""
    onnxruntime.create_and_register_allocator(
        onnxruntime.OrtMemoryInfo(
            "Cpu", onnxruntime.OrtAllocatorType.ORT_ARENA_ALLOCATOR, 0, onnxruntime.OrtMemType.DEFAULT
        ),
        onnxruntime.OrtArenaCfg({"max_mem": MAX_MEMORY, "arena_extend_strategy": 0}),
    )
