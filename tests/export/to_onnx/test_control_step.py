"""The form of the graph: format and size (what it computes is tested in tests/parity); and its portable form, with
which runtimes of others compute what the reference in NumPy does."""

from dataclasses import replace
from typing import Any

import numpy as np
import onnx
import pytest
from onnx import TensorProto

from benchmarks.controller.runtimes import RUNTIMES, OtherRuntime
from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig
from contract.errors import ExportError
from contract.shipped import BUNDLE
from examples.random_programs import random_program
from export.gates import check_lowering
from export.int8 import effective, rounded_to_nearest
from export.program.controller_program import matrices, random_windows
from export.to_onnx.control_step import build_controller
from export.to_onnx.portable import portable
from tests.export.release.test_judged import nodes_of

SMALL = ModelConfig(window=5, latent=3, lstm_width=5, dynamics_width=10, decoder_width=8)
LOWERINGS = (lambda program: program, rounded_to_nearest)
"""In float32 and int8."""


def test_the_opset_and_the_format_are_those_that_onnx_runtime_1_20_knows():
    for lowered in LOWERINGS:
        graph = build_controller(lowered(random_program(0, model=SMALL, prior_memory=24)))
        assert [(entry.domain, entry.version) for entry in graph.opset_import] == [("", 18)]
        assert graph.ir_version <= 10


def test_nothing_is_unrolled():
    def count(**mpc: Any) -> int:
        program = random_program(0, model=SMALL, mpc=MpcConfig(**mpc))
        return len(nodes_of(build_controller(program).graph))

    assert count(horizon=5, iterations=2) == count(horizon=50, iterations=20)
    assert count(horizon=5, iterations=2) < 300


def test_int8_weights_are_a_byte_each_and_dequantised_once():
    program = random_program(0)
    whole, small = (build_controller(of) for of in (program, rounded_to_nearest(program)))
    stored = [t for t in small.graph.initializer if t.data_type == TensorProto.INT8 and len(t.dims) >= 2]
    assert sum(int(np.prod(t.dims)) for t in stored) == sum(one.size for one in matrices(program).values())
    floats = [t for t in small.graph.initializer if t.data_type == TensorProto.FLOAT and len(t.dims) == 2]
    # Rows of biases, and the cost's three quadratic forms; no matrix of the networks is left.
    assert [t.dims for t in floats if min(t.dims) > 1] == 3 * [[program.mpc.horizon] * 2]
    assert small.ByteSize() < whole.ByteSize() / 3
    assert whole.ByteSize() < 600_000
    # Dequantisation happens outside the scans.
    graph = build_controller(rounded_to_nearest(random_program(0, model=SMALL, prior_memory=24))).graph
    outside = sum(node.op_type == "DequantizeLinear" for node in graph.node)
    # LSTM 2, encoder 2, dynamics 3, decoder 2 and one a block, prior 2.
    assert outside == 11 + SMALL.decoder_blocks
    assert sum(node.op_type == "DequantizeLinear" for node in nodes_of(graph)) == outside
    # onnxruntime 1.20 aborts where a per-row DequantizeLinear feeds an operator that only rearranges.
    weights = {node.output[0] for node in graph.node if node.op_type == "DequantizeLinear"}
    consumers = {node.op_type for node in nodes_of(graph) if weights & set(node.input)}
    assert consumers <= {"LSTM", "Gemm", "MatMul", "Sub", "Mul", "ReduceMean"}


def test_values_that_float32_cannot_hold_are_refused():
    for lowered in LOWERINGS:
        program = random_program(0, model=SMALL)
        hidden = program.dynamics.hidden
        for layer in (
            replace(hidden, weight=np.full_like(hidden.weight, 1e300)),
            replace(hidden, bias=np.linspace(-1e39, 1e39, len(hidden.bias))),
        ):
            broken = replace(program, dynamics=replace(program.dynamics, hidden=layer))
            with pytest.raises(ExportError, match=r"dynamics\.hidden\.(weight|bias).*too large for float32"):
                build_controller(lowered(broken))
        tiny = replace(program.scaling, pressure_std=(1e-60, 1.0, 1.0, 1.0))
        with pytest.raises(ExportError, match="window_std: a value is too large"):
            build_controller(lowered(replace(program, scaling=tiny)))


# OpenVINO mistakes a square matrix that is used both ways for its transpose, unless the horizon is 4, 6 or 8.
SQUARE = ModelConfig(window=5, latent=8, lstm_width=5, dynamics_width=8, decoder_width=8)


@pytest.mark.slow  # OpenVINO and tract take seconds to open a graph
def test_every_runtime_computes_the_reference(tmp_path):
    mpc = MpcConfig(horizon=6, iterations=2)
    rounded = rounded_to_nearest(random_program(3, model=SQUARE, mpc=mpc, prior_memory=24))
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
