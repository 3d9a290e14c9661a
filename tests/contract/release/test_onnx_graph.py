"""What is refused in a graph's bytes before ONNX Runtime sees them, against graphs that the `onnx` package makes."""

import numpy as np
import onnx
import pytest
from onnx import helper

from contract.release.checks import CONTROLLER
from contract.release.onnx_graph import MAX_BYTES, check_graph
from contract.shipped import BUNDLE
from tests.contract.controller.graphs import constant, graph_of, outside


def in_an_attribute() -> onnx.NodeProto:
    """A tensor in another file, one level deeper than the graph's own constants."""
    return helper.make_node("Constant", [], ["x"], value=outside())


def test_what_reads_files_or_is_not_onnxs_own_is_refused_wherever_it_stands():
    body = graph_of([in_an_attribute()]).graph
    for content, named in (
        (graph_of((), [outside()]), "kept in another file"),
        (graph_of([in_an_attribute()]), "kept in another file"),
        (graph_of([helper.make_node("If", ["plan"], ["x"], then_branch=body, else_branch=body)]), "another file"),
        (graph_of([helper.make_node("Gelu", ["plan"], ["x"], domain="com.microsoft")]), "own domain"),
        (graph_of([helper.make_node("Scaler", ["plan"], ["x"], domain="ai.onnx.ml")]), "another domain"),
        (graph_of((), [constant("c", np.zeros(MAX_BYTES // 4))]), f"at most {MAX_BYTES}"),
    ):
        with pytest.raises(ValueError, match=named):
            check_graph(content.SerializeToString())
    check_graph(graph_of().SerializeToString())
    check_graph((BUNDLE / CONTROLLER).read_bytes())
