"""What is signed: sound graphs of the export's operators that compute what the manifest gives."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import onnx
import pytest
from onnx import TensorProto, helper

from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig
from contract.errors import BundleControllerError
from contract.release import bundle
from contract.release.checks import CONTROLLER
from contract.shipped import BUNDLE
from examples.random_programs import random_program
from export.int8 import rounded_to_nearest
from export.release.judged import OPERATORS, check_model, judge
from export.to_onnx.control_step import build_controller
from tests.contract.controller.graphs import endless, graph_of, value


def nodes_of(graph: onnx.GraphProto) -> list[onnx.NodeProto]:
    bodies = [part.g for node in graph.node for part in node.attribute if part.HasField("g")]
    return [*graph.node, *(node for body in bodies for node in nodes_of(body))]


def test_the_operators_are_those_that_the_export_writes():
    model = ModelConfig(window=4, latent=3, lstm_width=8, dynamics_width=16, decoder_width=8)
    program = random_program(1, model=model, mpc=MpcConfig(horizon=5), prior_memory=6)
    graphs = [build_controller(program), build_controller(rounded_to_nearest(program))]
    graphs.append(onnx.load_from_string((BUNDLE / CONTROLLER).read_bytes()))
    for graph in graphs:
        assert check_model(graph.SerializeToString()) == len(nodes_of(graph.graph))
    assert {node.op_type for graph in graphs for node in nodes_of(graph.graph)} == OPERATORS


def node(kind: str, **attributes: Any) -> bytes:
    return graph_of([helper.make_node(kind, ["plan"], ["x"], **attributes)]).SerializeToString()


def test_what_no_controller_needs_is_refused_by_name():
    short = TensorProto(name="c", data_type=1, dims=[2], raw_data=b"\0" * 4)
    cut = [
        helper.make_node("Cast", ["plan"], ["count"], to=TensorProto.INT64),
        helper.make_node("Slice", ["zero_forces", "count", "count"], ["few"]),
    ]
    with_function = graph_of()
    with_function.functions.add(name="f", domain="d")
    for content, named in (
        (endless(), "operator 'Loop'"),
        (node("RandomNormalLike"), "operator 'RandomNormalLike'"),
        (node("Relu", domain="com.evil"), "com.evil"),
        (node("Relu", alpha=1.0), "alpha"),
        (node("Concat", axis=1.5), "axis"),
        (node("Nonsense"), "Nonsense"),
        (graph_of(cut).SerializeToString(), "input 'count' of Slice is computed"),
        (graph_of((), [short]).SerializeToString(), "onnx refuses the graph"),
        (with_function.SerializeToString(), "function|refuses"),
        (b"not really ONNX", "onnx refuses the graph"),
    ):
        with pytest.raises(ValueError, match=named):
            check_model(content)


def test_a_graph_that_does_not_compute_what_the_manifest_gives_is_not_signed(tmp_path):
    sound = bundle.load(BUNDLE)
    judge(sound)
    changes: list[tuple[Callable[[onnx.ModelProto], object], str]] = [
        (lambda model: model.graph.input[0].CopyFrom(value("window", (2, 3))), "dimensions"),
        (lambda model: model.graph.output.pop(0), "new_plan|checker|refuses"),
        (lambda model: model.graph.input.append(value("mode", (1,))), "mode"),
    ]
    for change, named in changes:
        model = onnx.load_from_string(sound.files[CONTROLLER])
        change(model)
        with pytest.raises(BundleControllerError, match=named):
            judge(replace(sound, files={**sound.files, CONTROLLER: model.SerializeToString()}))
