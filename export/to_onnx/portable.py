"""The conversion of a release's graphs to graphs without Scan and int8, for runtimes that support fewer operators. The
number of nodes grows with the horizon and the iterations. If a graph uses a square constant and also its transpose,
OpenVINO 2026.4 always multiplies by the transpose, so this module writes two constants."""

from collections.abc import Iterable
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper
from onnxruntime import InferenceSession


def portable(model: onnx.ModelProto) -> onnx.ModelProto:
    """Return a graph of a release with each Scan replaced by its steps, in order. Each value that depends on no input
    is replaced by a constant. A caller must give every input, because other runtimes take defaults as constants."""
    graph = model.graph
    writer = _Writer(graph)
    nodes = writer.written(graph.node, {}, "")
    known = set(writer.constants)
    fixed: list[onnx.NodeProto] = []
    left: list[onnx.NodeProto] = []
    for node in nodes:
        is_fixed = known.issuperset(node.input)
        (fixed if is_fixed else left).append(node)
        known |= set(node.output) if is_fixed else set()
    used = {name for node in left for name in node.input}
    folded = [name for node in fixed for name in node.output if name in used]
    outputs = [helper.make_tensor_value_info(name, TensorProto.FLOAT, None) for name in folded]
    session = InferenceSession(_model(model, fixed, [], outputs, writer.constants).SerializeToString())
    for name, values in zip(folded, session.run(folded, {}), strict=True):
        writer.constants[name] = numpy_helper.from_array(values, name)
    whole = _model(model, left, graph.input, graph.output, writer.constants)
    onnx.checker.check_model(whole, full_check=True)
    return whole


def _model(
    like: onnx.ModelProto, nodes: Any, inputs: Any, outputs: Any, known: dict[str, onnx.TensorProto]
) -> onnx.ModelProto:
    used = {name for node in nodes for name in node.input}
    constants = [constant for name, constant in known.items() if name in used]
    made = onnx.ModelProto()
    made.CopyFrom(like)
    made.graph.CopyFrom(helper.make_graph(nodes, like.graph.name, inputs, outputs, constants))
    return made


class _Writer:
    """A writer of nodes without Scan. If the first sequence of a Scan is a constant, such as the rates of the
    iterations, each row of the constant is a step of the Scan. Otherwise each action of the horizon is a step."""

    def __init__(self, graph: onnx.GraphProto) -> None:
        inputs = {value.name: value for value in graph.input}
        self.constants = {one.name: one for one in graph.initializer if one.name not in inputs}
        self._horizon = inputs["plan"].type.tensor_type.shape.dim[0].dim_value if "plan" in inputs else 0

    def written(self, nodes: Iterable[Any], names: dict[str, str], suffix: str) -> list[onnx.NodeProto]:
        """Return the nodes without Scan; `suffix` is appended to the names of their outputs. `names` maps the names in
        a body to the names in this graph; the names of the outputs are added to `names`."""
        found = []
        for node in nodes:
            if node.op_type == "Scan":
                found += self._scan(node, names, suffix)
                continue
            copy = onnx.NodeProto()
            copy.CopyFrom(node)
            copy.input[:] = [names.get(name, name) for name in node.input]
            if node.op_type == "CumSum":
                # ONNX's standard requires a scalar axis; ONNX Runtime also accepts an array of length one.
                copy.input[1] = self._constant(0)
            names |= {name: name + suffix for name in node.output if name and suffix}
            copy.output[:] = [names.get(name, name) for name in node.output]
            found.append(copy)
        return found

    def _scan(self, scan: Any, names: dict[str, str], suffix: str) -> list[onnx.NodeProto]:
        given = {attribute.name: helper.get_attribute_value(attribute) for attribute in scan.attribute}
        body, count = given["body"], len(scan.input) - given["num_scan_inputs"]
        values = [names.get(name, name) for name in scan.input]
        states, sequences = values[:count], values[count:]
        rates = self.constants.get(sequences[0])
        length = self._horizon if rates is None else rates.dims[0]
        inputs, outputs = ([value.name for value in side] for side in (body.input, body.output))
        found, rows = [], []
        for step in range(length):
            inside = names | dict(zip(inputs, states, strict=False))
            for name, sequence, reverse in zip(inputs[count:], sequences, given["scan_input_directions"], strict=True):
                inside[name] = f"{name}{suffix}.{step}"
                place = self._constant(length - 1 - step if reverse else step)
                found.append(helper.make_node("Gather", [sequence, place], [inside[name]], axis=0))
            found += self.written(body.node, inside, f"{suffix}.{step}")
            states = [inside[name] for name in outputs[:count]]
            rows.append([inside[name] for name in outputs[count:]])
        names |= dict(zip(scan.output, states, strict=False))
        directions = given.get("scan_output_directions", [])
        stacked = zip(scan.output[count:], body.output[count:], directions, zip(*rows, strict=True), strict=True)
        for name, value, reverse, column in stacked:
            names[name] = name + suffix
            shape = [dimension.dim_value for dimension in value.type.tensor_type.shape.dim]
            joined = f"{names[name]}.rows"
            found.append(helper.make_node("Concat", column[::-1] if reverse else column, [joined], axis=0))
            whole = self._constant([length, *shape])
            found.append(helper.make_node("Reshape", [joined, whole], [names[name]]))
        return found

    def _constant(self, values: int | list[int]) -> str:
        name = f"int64 {values}"
        self.constants[name] = numpy_helper.from_array(np.array(values, np.int64), name)
        return name
