"""The release's graph in other runtimes of ONNX: the largest differences from the results of ONNX Runtime.

    python -m benchmarks runtimes [--json FILE]

Each runtime computes the same control steps, for recorded windows and several weights, speeds and limits. It uses the
portable form of the release's controller (`export.to_onnx.portable`). ONNX Runtime computes these steps with the graph
that is in the release.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import onnx
import openvino
import tract
from onnx.reference import ReferenceEvaluator
from onnxruntime import InferenceSession, SessionOptions

from benchmarks.common.command_line import JsonFile, report, track
from benchmarks.controller import tables
from contract.arrays import Array
from contract.controller.interface import INPUTS, OUTPUTS, ControlStep
from contract.model import model_folder
from contract.recording import dataset
from contract.release import bundle
from contract.release.checks import CONTROLLER
from contract.results import versions
from contract.runtime.onnx_session import OnnxController
from contract.shipped import BUNDLE, MODEL, recording
from export.gates import control_cases
from export.program.controller_program import ControllerProgram, program_of, recorded_windows
from export.to_onnx.portable import portable

WINDOWS: Final = 100
"""Number of control steps that each runtime computes."""

Run = Callable[[Mapping[str, npt.NDArray[np.float32]]], Mapping[str, Any]]
"""A function that computes the outputs from the inputs, both by name."""


class OtherRuntime:
    """A controller whose steps are computed by another runtime, with the portable graph of a program."""

    def __init__(self, run: Run, program: ControllerProgram) -> None:
        self._run, self._program = run, program

    def control_step(
        self,
        window: Array,
        plan: Array,
        free: Array,
        weights: Array | None = None,
        speed: float = 1.0,
        limit: float | None = None,
    ) -> ControlStep:
        """Compute a control step (`contract.controller.interface`)."""
        program = self._program
        given = window, plan, free, weights, speed, limit
        default = dict(weights=program.mpc.weights.as_tuple(), limit=program.action_limit)
        feeds = {
            name: np.asarray(default[name] if value is None else value, dtype=np.float32)
            for name, value in zip(INPUTS, given, strict=True)
            if name != "speed" or program.knows_speed
        }
        found = self._run(feeds)
        new_plan, forces, terms, cost = (np.asarray(found[name], dtype=np.float64) for name in OUTPUTS)
        return ControlStep(plan=new_plan, forces=forces, terms=terms, cost=float(cost))


def _onnxruntime(graph: Path) -> Run:
    options = SessionOptions()
    options.intra_op_num_threads = 1
    return _by_name(InferenceSession(graph, options))


def _by_name(session: Any) -> Run:
    return lambda feeds: dict(zip(OUTPUTS, session.run(list(OUTPUTS), dict(feeds)), strict=True))


def _openvino(graph: Path) -> Run:
    # Without this hint OpenVINO 2026.4 computes numbers that are not finite.
    compiled: Any = openvino.Core().compile_model(graph, "CPU", {"EXECUTION_MODE_HINT": "ACCURACY"})
    return lambda feeds: compiled(dict(feeds))


def _tract(graph: Path) -> Run:
    inferred = tract.onnx().load(graph)
    names = [inferred.input_name(i) for i in range(inferred.input_count())]
    runnable = inferred.into_model().into_runnable()

    def run(feeds: Mapping[str, Any]) -> Mapping[str, Any]:
        found = runnable.run([feeds[name] for name in names])
        return dict(zip(OUTPUTS, (value.to_numpy() for value in found), strict=True))

    return run


RUNTIMES: Final[Mapping[str, tuple[str, Callable[[Path], Run]]]] = {
    "ONNX Runtime": ("onnxruntime", _onnxruntime),
    "onnx's reference evaluator": ("onnx", lambda graph: _by_name(ReferenceEvaluator(str(graph)))),
    "OpenVINO": ("openvino", _openvino),
    "tract": ("tract", _tract),
}
"""The package of each runtime and the function that opens a graph in this runtime, by the runtime's name."""


def main(json_file: JsonFile = None) -> None:
    """Compare each runtime with ONNX Runtime and print a table."""
    release = bundle.load(BUNDLE)
    graph = release.files[CONTROLLER]
    program = program_of(model_folder.read(MODEL), release.manifest.mpc)
    episode = dataset.read(recording()).with_role("test")[0]
    cases = list(control_cases(program, recorded_windows(program, episode, WINDOWS)))
    truth = OnnxController(graph, program.sizes)
    expected = [truth.control_step(*case) for case in cases]
    model = portable(onnx.load_from_string(graph))
    figures = []
    with TemporaryDirectory() as folder:
        path = Path(folder, "portable.onnx")
        onnx.save(model, path)
        for name, (package, opened) in track(list(RUNTIMES.items()), "runtimes", "runtimes"):
            controller = OtherRuntime(opened(path), program)
            found = [controller.control_step(*case) for case in cases]
            pairs = list(zip(found, expected, strict=True))
            differences = {
                field: max(float(np.abs(getattr(a, field) - getattr(b, field)).max()) for a, b in pairs)
                for field in ("plan", "forces", "cost")
            }
            figures.append({"runtime": name, "version": versions(package)[package], **differences})
    facts: dict[str, Any] = {"bundle": release.manifest.name, "digest": release.digest, "windows": WINDOWS}
    facts |= {"nodes": len(model.graph.node), "versions": versions("stillwake", "onnxruntime")}
    report(json_file, figures, facts, tables.runtimes)
