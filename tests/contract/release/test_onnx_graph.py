"""What a controller's graph may hold, against graphs that the `onnx` package makes."""

from typing import Any

import numpy as np
import onnx
import pytest
from hypothesis import given
from hypothesis import strategies as st
from onnx import TensorProto, helper

from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig
from contract.controller.interface import Sizes
from contract.release import onnx_graph
from contract.release.bundle import CONTROLLER
from contract.release.onnx_graph import OPERATORS, check_graph
from contract.shipped import BUNDLE
from export.int8.rounded_program import rounded_to_nearest
from export.program.random_program import random_program
from export.to_onnx.control_step import build_controller
from tests.contract.controller.graphs import SIZES, constant, edited, endless, graph_of, outside, value
from tests.examples import examples


def nodes_of(graph: onnx.GraphProto) -> list[onnx.NodeProto]:
    """All nodes, those of bodies included, as the `onnx` package finds them."""
    bodies = [part.g for node in graph.node for part in node.attribute if part.HasField("g")]
    return [*graph.node, *(node for body in bodies for node in nodes_of(body))]


def exported() -> dict[str, tuple[onnx.ModelProto, Sizes]]:
    """What the export writes, in both precisions, and the shipped graph."""
    model = ModelConfig(window=4, latent=3, lstm_width=8, dynamics_width=16, decoder_width=8)
    program = random_program(1, model=model, mpc=MpcConfig(horizon=5))
    shipped = onnx.load_from_string((BUNDLE / CONTROLLER).read_bytes())
    return {
        "float32": (build_controller(program), program.sizes),
        "int8": (build_controller(rounded_to_nearest(program)), program.sizes),
        "shipped": (shipped, Sizes(window=32, sensors=4, horizon=25)),
    }


@pytest.mark.parametrize("name", ["float32", "int8", "shipped"])
def test_what_the_export_writes_passes_and_is_counted_as_onnx_counts_it(name):
    model, sizes = exported()[name]
    assert check_graph(model.SerializeToString(), sizes) == len(nodes_of(model.graph))


def test_nothing_more_is_allowed_than_the_export_writes():
    nodes = [node for model, _ in exported().values() for node in nodes_of(model.graph)]
    used = {node.op_type: set[str]() for node in nodes}
    for node in nodes:
        used[node.op_type] |= {part.name for part in node.attribute}
    used["Gemm"].add("alpha")  # in bundles of 0.5.0 and before, which are read
    assert used == {name: set(attributes) for name, attributes in OPERATORS.items()}


def test_a_small_graph_passes_before_anything_is_planted():
    assert check_graph(graph_of().SerializeToString(), SIZES) == 4


def node(kind: str, **attributes: Any) -> bytes:
    return graph_of([helper.make_node(kind, ["plan"], ["x"], **attributes)]).SerializeToString()


def with_constant(tensor: TensorProto) -> bytes:
    return graph_of((), [tensor]).SerializeToString()


def scans(depth: int) -> bytes:
    """Scans within each other."""
    inner = [helper.make_node("Identity", ["s0"], ["t0"])]
    for level in range(1, depth + 1):
        names = (f"s{level - 1}", f"x{level - 1}"), (f"t{level - 1}",)
        body = helper.make_graph(
            inner, f"body{level}", [value(name, (1,)) for name in names[0]], [value(names[1][0], (1,))]
        )
        inner = [helper.make_node("Scan", [f"s{level}", "plan"], [f"t{level}"], body=body, num_scan_inputs=1)]
    return graph_of(inner, [constant(f"s{depth}", [0.0])]).SerializeToString()


def attribute_twice(model: onnx.ModelProto) -> None:
    part = model.graph.node[3].attribute[0]
    model.graph.node[3].attribute.append(part)


def attribute_of_two_types(model: onnx.ModelProto) -> None:
    model.graph.node[3].attribute[0].f = 1.0


PLANTED: dict[str, tuple[bytes, str]] = {
    "loop": (node("Loop", body=graph_of().graph), "operator 'Loop': no controller"),
    "endless": (endless(), "constant 'yes' is of type 9"),
    "if": (node("If", then_branch=graph_of().graph, else_branch=graph_of().graph), "operator 'If'"),
    "random": (node("RandomNormalLike"), "operator 'RandomNormalLike'"),
    "expand": (node("Expand"), "operator 'Expand'"),
    "escape in an operator": (node("\x1b[2J"), r"operator '\x1b[2J'"),
    "domain": (node("Relu", domain="com.evil"), "operator 'Relu' of domain 'com.evil'"),
    "second operator set": (
        edited(lambda m: m.opset_import.append(helper.make_opsetid("ai.onnx.ml", 3))),
        "with operator sets",
    ),
    "old operators": (edited(lambda m: setattr(m.opset_import[0], "version", 7)), "of version 7: must be 18"),
    "IR version": (edited(lambda m: setattr(m, "ir_version", 99)), "IR version 99"),
    "function": (
        edited(lambda m: m.functions.add(name="f", domain="")),
        "brings functions of its own",
    ),
    "training": (edited(lambda m: m.training_info.add()), "training information"),
    "metadata": (edited(lambda m: m.metadata_props.add(key="a", value="b")), "field 14 is not expected"),
    "unknown attribute": (node("Relu", alpha=1.0), "Relu has attribute 'alpha'"),
    "attribute of another type": (node("Concat", axis=1.5), "attribute 'axis' of Concat is not of its type"),
    "attribute twice": (edited(attribute_twice), "ReduceSum has attribute 'keepdims'"),
    "attribute of two types": (edited(attribute_of_two_types), "attribute 'keepdims' of ReduceSum"),
    "graph in a plain operator": (node("Relu", body=graph_of().graph), "Relu has attribute 'body'"),
    "scan without a body": (node("Scan", num_scan_inputs=1), "a Scan has no body"),
    "scans too deep": (scans(3), "more than 2 deep"),
    "external constant": (with_constant(outside()), "constant 'outside' is kept in another file"),
    "NaN": (with_constant(constant("c", [1.0, np.nan])), "constant 'c' is not finite"),
    "infinity": (with_constant(constant("c", np.inf)), "constant 'c' is not finite"),
    "double": (with_constant(constant("c", 1.0, np.float64)), "constant 'c' is of type 11"),
    "string": (
        with_constant(TensorProto(name="c", data_type=TensorProto.STRING, dims=[1], string_data=[b"x"])),
        "field 6 is not expected",
    ),
    "short constant": (
        with_constant(TensorProto(name="c", data_type=1, dims=[2], raw_data=b"\0" * 4)),
        "constant 'c' has 4 bytes",
    ),
    "negative side": (
        with_constant(TensorProto(name="c", data_type=1, dims=[-1, -1], raw_data=b"\0" * 4)),
        "constant 'c' has 4 bytes",
    ),
    "many sides": (with_constant(TensorProto(name="c", data_type=1, dims=[1] * 9)), "dims is there more than 8 times"),
    "constant twice": (with_constant(constant("zero_forces", 1.0)), "constant 'zero_forces' is there twice"),
    "constant named with an escape": (with_constant(constant("\x1b[2J", 1.0)), "short printable name"),
    "sparse constant": (edited(lambda m: m.graph.sparse_initializer.add()), "sparse constants"),
    "further input": (edited(lambda m: m.graph.input.append(value("mode", (1,)))), "input 'mode': must be one of"),
    "further output": (edited(lambda m: m.graph.output.append(value("log", (1,)))), "output 'log': must be one of"),
    "missing input": (edited(lambda m: m.graph.input.pop(2)), "input 'free' is missing"),
    "missing output": (edited(lambda m: m.graph.output.pop(0)), "output 'new_plan' is missing"),
    "input of another shape": (
        edited(lambda m: m.graph.input[0].CopyFrom(value("window", (2, 3)))),
        "'window' has shape (2, 3), must have (2, 2)",
    ),
    "input of any shape": (
        edited(lambda m: setattr(m.graph.input[0].type.tensor_type.shape.dim[0], "dim_param", "n")),
        "input 'window' has no fixed shape",
    ),
    "input of doubles": (
        edited(lambda m: setattr(m.graph.input[0].type.tensor_type, "elem_type", 11)),
        "input 'window' must be float32",
    ),
    "default of an input": (with_constant(constant("plan", np.zeros(3))), "input 'plan' has a default"),
    "no default of the weights": (edited(lambda m: m.graph.initializer.pop(0)), "input 'weights' has no default"),
    "many nodes": (
        graph_of([helper.make_node("Relu", ["plan"], [f"x{i}"]) for i in range(4097)]).SerializeToString(),
        "node is there more than 4096 times",
    ),
    "many inputs of a node": (
        graph_of([helper.make_node("Concat", ["plan"] * 33, ["x"], axis=0)]).SerializeToString(),
        "input is there more than 32 times",
    ),
    "no graph": (
        onnx.ModelProto(ir_version=8, opset_import=[helper.make_opsetid("", 18)]).SerializeToString(),
        "graph",
    ),
    "two graphs": (graph_of().SerializeToString() * 2, "ir_version is there twice"),
    "nothing": (b"", "IR version None"),
    "no model": (b"not really ONNX", "the file cannot be read"),
}


@pytest.mark.parametrize("name", PLANTED)
def test_what_no_controller_needs_is_refused_by_name(name):
    content, named = PLANTED[name]
    with pytest.raises(ValueError, match=r"\A.*\Z") as refused:
        check_graph(content, SIZES)
    assert named in str(refused.value)


def test_a_file_that_is_too_large_is_refused():
    with pytest.raises(ValueError, match=f"at most {onnx_graph.MAX_BYTES}"):
        check_graph(bytes(onnx_graph.MAX_BYTES + 1), SIZES)


SOUND = graph_of().SerializeToString()


@pytest.mark.slow  # hundreds of graphs
@examples(500)
@given(data=st.data())
def test_a_damaged_file_is_refused_or_is_the_graph_that_onnx_reads(data):
    """Whatever passes, the `onnx` package reads as a graph of allowed operators, too: no second reading."""
    content = bytearray(SOUND)
    for _ in range(data.draw(st.integers(1, 3))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    try:
        count = check_graph(bytes(content), SIZES)
    except ValueError:
        return
    model = onnx.load_from_string(bytes(content))
    assert count == len(nodes_of(model.graph))
    assert {node.op_type for node in model.graph.node} <= OPERATORS.keys()
    assert not any(tensor.external_data or tensor.data_location for tensor in model.graph.initializer)


def test_cut_anywhere_it_is_refused():
    for size in range(len(SOUND)):
        with pytest.raises(ValueError):  # What is missing depends on where it is cut.
            check_graph(SOUND[:size], SIZES)
