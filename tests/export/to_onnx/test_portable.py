"""The portable graph in runtimes of others: each computes what the reference in NumPy does."""

import onnx
import pytest

from benchmarks.controller.runtimes import RUNTIMES, OtherRuntime
from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig
from contract.shipped import BUNDLE
from examples.random_programs import random_program
from export.gates import check_lowering
from export.int8 import effective, rounded_to_nearest
from export.program.controller_program import random_windows
from export.to_onnx.control_step import build_controller
from export.to_onnx.portable import portable

# OpenVINO mistakes a square matrix that is used both ways for its transpose, unless the horizon is 4, 6 or 8.
SMALL = ModelConfig(window=5, latent=8, lstm_width=5, dynamics_width=8, decoder_width=8)


@pytest.mark.slow  # OpenVINO and tract take seconds to open a graph
def test_every_runtime_computes_the_reference(tmp_path):
    mpc = MpcConfig(horizon=6, iterations=2)
    rounded = rounded_to_nearest(random_program(3, model=SMALL, mpc=mpc, prior_memory=24))
    onnx.save(portable(build_controller(rounded)), tmp_path / "portable.onnx")
    program = effective(rounded)
    for name, (_, opened) in RUNTIMES.items():
        runtime = OtherRuntime(opened(tmp_path / "portable.onnx"), program)
        check_lowering(program, runtime, name, random_windows(program, 3))


def test_the_shipped_graphs_have_a_portable_form():
    for name, nodes in (("controller.onnx", range(1000, 2000)), ("sensors.onnx", range(1, 60))):
        graph = portable(onnx.load(BUNDLE / name)).graph
        assert len(graph.node) in nodes
        assert not {"Scan", "DequantizeLinear"} & {node.op_type for node in graph.node}
        assert not {value.name for value in graph.input} & {constant.name for constant in graph.initializer}
