"""A bundle's graphs, judged before ONNX Runtime sees them: each holds one computation, and nothing that acts otherwise.

A bundle may come from anyone, and a signature says who made it, not that it is sound. ONNX can read files beside the
model, loop without end, and bring operators of its own. So a graph may hold what `export.to_onnx` writes, and nothing
more: the operators in `OPERATORS` with those attributes, constants that are in the file and finite, `Scan` with bodies
of the same kind, and exactly the inputs and outputs of `contract.controller.interface`, or of
`contract.controller.estimator`.

What is left is ONNX's own business, which ONNX Runtime checks when it loads: types, shapes between nodes, names.
"""

from collections.abc import Mapping
from math import prod
from typing import Any, Final

import numpy as np

from contract.controller.estimator import ESTIMATOR_INPUT, ESTIMATOR_OUTPUT, estimator_shapes
from contract.controller.interface import INPUTS, OUTPUTS, Sizes
from contract.printable import is_name, quoted
from contract.release.protobuf import Field, Kind, Message, read

MAX_BYTES: Final = 16 * 2**20
"""Of the file: a hundred times the paper's controller in int8."""
MAX_NODES: Final = 4096
"""Of a graph and its bodies: the paper's controller has 264, however long its horizon."""
MAX_BODIES: Final = 2
"""Scans within each other: the optimiser's iterations, and the steps of the horizon."""
MAX_CONSTANTS: Final = 4096
OPSETS: Final = (18,)
IR_VERSIONS: Final = (8,)

_FLOAT, _INT, _BODY, _INTS = 1, 2, 5, 7
"""Types of attributes, in ONNX's numbers."""
_PLAIN: Final = (
    *("Abs", "Add", "Clip", "Div", "Elu", "Equal", "Exp", "Greater", "Identity", "MatMul", "Min", "Mul", "Relu"),
    *("Reshape", "Sign", "Slice", "Sqrt", "Squeeze", "Sub", "Unsqueeze", "Where"),
)
"""Operators without attributes."""
OPERATORS: Final[Mapping[str, Mapping[str, int]]] = {
    **{name: {} for name in _PLAIN},
    **{name: {"keepdims": _INT} for name in ("ReduceMax", "ReduceMean", "ReduceMin", "ReduceSum")},
    "Cast": {"to": _INT},
    "Concat": {"axis": _INT},
    "CumSum": {"reverse": _INT},
    "DequantizeLinear": {"axis": _INT},
    "Gemm": {"alpha": _FLOAT, "transB": _INT},
    "LSTM": {"hidden_size": _INT},
    "LayerNormalization": {"epsilon": _FLOAT},
    "Scan": {"body": _BODY, "num_scan_inputs": _INT, "scan_input_directions": _INTS, "scan_output_directions": _INTS},
    "Split": {"axis": _INT},
    "Transpose": {"perm": _INTS},
}
"""What may be computed, and the attributes that say how, with their types."""

_TYPES: Final[Mapping[int, np.dtype[Any]]] = {1: np.dtype("<f4"), 3: np.dtype("i1"), 7: np.dtype("<i8")}
"""Of constants: float32, int8 weights, int64 axes and shapes."""
_FLOAT32: Final = 1
_MAX_VALUES: Final = MAX_BYTES
_MAX_NAMES: Final = 32
"""Of inputs and outputs, of a node or a graph."""

_MODEL: Final = {
    1: Field("ir_version", Kind.INT),
    2: Field("producer_name", Kind.TEXT),
    3: Field("producer_version", Kind.TEXT),
    6: Field("doc_string", Kind.TEXT),
    7: Field("graph", Kind.BYTES),
    8: Field("opset_import", Kind.BYTES, most=4),
    20: Field("training_info", Kind.BYTES, most=1),
    25: Field("functions", Kind.BYTES, most=1),
}
_OPSET: Final = {1: Field("domain", Kind.TEXT), 2: Field("version", Kind.INT)}
_GRAPH: Final = {
    1: Field("node", Kind.BYTES, most=MAX_NODES),
    2: Field("name", Kind.TEXT),
    5: Field("initializer", Kind.BYTES, most=MAX_CONSTANTS),
    11: Field("input", Kind.BYTES, most=_MAX_NAMES),
    12: Field("output", Kind.BYTES, most=_MAX_NAMES),
    15: Field("sparse_initializer", Kind.BYTES, most=1),
}
_NODE: Final = {
    1: Field("input", Kind.TEXT, most=_MAX_NAMES),
    2: Field("output", Kind.TEXT, most=_MAX_NAMES),
    3: Field("name", Kind.TEXT),
    4: Field("op_type", Kind.TEXT),
    5: Field("attribute", Kind.BYTES, most=16),
    7: Field("domain", Kind.TEXT),
}
_ATTRIBUTE: Final = {
    1: Field("name", Kind.TEXT),
    2: Field("f", Kind.FLOAT),
    3: Field("i", Kind.INT),
    6: Field("g", Kind.BYTES),
    8: Field("ints", Kind.INT, most=64),
    20: Field("type", Kind.INT),
}
_VALUE_OF: Final = {_FLOAT: "f", _INT: "i", _BODY: "g", _INTS: "ints"}
_TENSOR: Final = {
    1: Field("dims", Kind.INT, most=8),
    2: Field("data_type", Kind.INT),
    8: Field("name", Kind.TEXT),
    9: Field("raw_data", Kind.BYTES),
    13: Field("external_data", Kind.BYTES, most=16),
    14: Field("data_location", Kind.INT),
}
_VALUE: Final = {1: Field("name", Kind.TEXT), 2: Field("type", Kind.BYTES)}
_TYPE: Final = {1: Field("tensor_type", Kind.BYTES)}
_TENSOR_TYPE: Final = {1: Field("elem_type", Kind.INT), 2: Field("shape", Kind.BYTES)}
_SHAPE: Final = {1: Field("dim", Kind.BYTES, most=8)}
_DIM: Final = {1: Field("dim_value", Kind.INT)}


def check_graph(content: bytes, sizes: Sizes) -> int:
    """Judge a controller's file.

    Args:
        sizes: those of the manifest, which its inputs and outputs must have.

    Returns:
        How many nodes it has, those of its bodies included.

    Raises:
        ValueError: it is no such graph; the message names what is in the way.
    """
    return _check(content, sizes.shapes(), inputs=INPUTS, outputs=OUTPUTS, default=INPUTS[-1])


def check_estimator_graph(content: bytes, sizes: Sizes) -> int:
    """The same for the file that estimates pressures."""
    shapes = estimator_shapes(sizes.window, sizes.sensors)
    return _check(content, shapes, inputs=(ESTIMATOR_INPUT,), outputs=(ESTIMATOR_OUTPUT,), default=None)


def _check(
    content: bytes,
    shapes: Mapping[str, tuple[int, ...]],
    *,
    inputs: tuple[str, ...],
    outputs: tuple[str, ...],
    default: str | None,
) -> int:
    """Judge a file with these inputs, of which one may have a default, and outputs; how many nodes it has."""
    if len(content) > MAX_BYTES:
        raise ValueError(f"it has {len(content)} bytes: at most {MAX_BYTES}")
    model = _read("the file", memoryview(content), _MODEL)
    if model["functions"]:
        raise ValueError("it brings functions of its own")
    if model["training_info"]:
        raise ValueError("it holds training information")
    _check_versions(model)
    if model["graph"] is None:
        raise ValueError("it has no graph")
    graph = _read("the graph", model["graph"], _GRAPH)
    for direction, names in (("input", inputs), ("output", outputs)):
        found = _signature(direction, graph)
        for name in found:
            if name not in names:
                raise ValueError(f"{direction} {quoted(name)}: must be one of {', '.join(names)}")
        for name in names:
            if name not in found:
                raise ValueError(f"{direction} {name!r} is missing")
            if found[name] != shapes[name]:
                raise ValueError(f"{name!r} has shape {found[name]}, must have {shapes[name]}")
    constants = _constants(graph)
    for name in inputs:
        if name != default and name in constants:
            only = "none" if default is None else f"only {default!r}"
            raise ValueError(f"input {name!r} has a default: {only} may")
    if default is not None and default not in constants:
        raise ValueError(f"input {default!r} has no default")
    return _check_nodes(graph, 0, MAX_NODES)


def _read(where: str, data: memoryview, schema: Mapping[int, Field]) -> Message:
    try:
        return read(data, schema)
    except ValueError as error:
        raise ValueError(f"{where} cannot be read: {error}") from error


def _check_versions(model: Message) -> None:
    opsets = [_read("an operator set", data, _OPSET) for data in model["opset_import"]]
    if model["ir_version"] not in IR_VERSIONS or [item["domain"] or "" for item in opsets] != [""]:
        raise ValueError(
            f"it is of IR version {model['ir_version']} with operator sets "
            f"{[quoted(item['domain'] or '') for item in opsets]}: must be of {IR_VERSIONS[0]} with ONNX's own alone"
        )
    if opsets[0]["version"] not in OPSETS:
        raise ValueError(f"its operators are of version {opsets[0]['version']}: must be {OPSETS[0]}")


def _check_nodes(graph: Message, depth: int, left: int) -> int:
    """Judge the nodes of a graph and of its bodies; how many there are."""
    count = len(graph["node"])
    if count > left:
        raise ValueError(f"it has more than {MAX_NODES} nodes")
    for data in graph["node"]:
        node = _read("a node", data, _NODE)
        kind = node["op_type"]
        if node["domain"]:
            raise ValueError(f"operator {quoted(kind)} of domain {quoted(node['domain'])}: must be one of ONNX's own")
        if kind not in OPERATORS:
            raise ValueError(f"operator {quoted(kind)}: no controller computes with it")
        for attribute in _attributes(kind, node).values():
            if attribute["g"] is not None:
                count += _check_body(attribute["g"], depth + 1, left - count)
    return count


def _attributes(kind: str, node: Message) -> dict[str, Message]:
    known = OPERATORS[kind]
    found: dict[str, Message] = {}
    for data in node["attribute"]:
        attribute = _read(f"an attribute of {kind}", data, _ATTRIBUTE)
        name, stored = attribute["name"], attribute["type"]
        if name in found or name not in known:
            raise ValueError(f"{kind} has attribute {quoted(name)}, which it must not have, or twice")
        present = {field for field in _VALUE_OF.values() if attribute[field] not in (None, [])}
        if stored != known[name] or not present <= {_VALUE_OF[stored]}:
            raise ValueError(f"attribute {name!r} of {kind} is not of its type")
        found[name] = attribute
    if kind == "Scan" and found.get("body", {}).get("g") is None:
        raise ValueError("a Scan has no body")
    return found


def _check_body(data: memoryview, depth: int, left: int) -> int:
    if depth > MAX_BODIES:
        raise ValueError(f"its Scans stand more than {MAX_BODIES} deep in each other")
    body = _read("the body of a Scan", data, _GRAPH)
    _constants(body)
    for direction in ("input", "output"):
        _signature(direction, body)
    return _check_nodes(body, depth, left)


def _constants(graph: Message) -> set[str]:
    """The names of a graph's constants, each of them in the file, whole and finite."""
    if graph["sparse_initializer"]:
        raise ValueError("it has sparse constants")
    if len(graph["initializer"]) > MAX_CONSTANTS:
        raise ValueError(f"it has more than {MAX_CONSTANTS} constants")
    names: set[str] = set()
    for data in graph["initializer"]:
        tensor = _read("a constant", data, _TENSOR)
        name = _named("a constant", tensor)
        if name in names:
            raise ValueError(f"constant {name!r} is there twice")
        names.add(name)
        if tensor["external_data"] or tensor["data_location"]:
            raise ValueError(f"constant {name!r} is kept in another file: must be in this one")
        kind, sides = _TYPES.get(tensor["data_type"]), tensor["dims"]
        if kind is None:
            raise ValueError(f"constant {name!r} is of type {tensor['data_type']}: must be float32, int8 or int64")
        raw = tensor["raw_data"] if tensor["raw_data"] is not None else memoryview(b"")
        if not all(0 <= side <= _MAX_VALUES for side in sides) or prod(sides) * kind.itemsize != len(raw):
            raise ValueError(f"constant {name!r} has {len(raw)} bytes, which do not fill its shape")
        if kind.kind == "f" and not np.isfinite(np.frombuffer(raw, dtype=kind)).all():
            raise ValueError(f"constant {name!r} is not finite")
    return names


def _signature(direction: str, graph: Message) -> dict[str, tuple[int, ...]]:
    """The shapes of all inputs or outputs by name, all of them float32."""
    found: dict[str, tuple[int, ...]] = {}
    for data in graph[direction]:
        value = _read(f"an {direction}", data, _VALUE)
        name = _named(f"an {direction}", value)
        if name in found:
            raise ValueError(f"{direction} {name!r} is there twice")
        found[name] = _shape(f"{direction} {name!r}", value)
    return found


def _shape(where: str, value: Message) -> tuple[int, ...]:
    try:
        tensor = read(_present(read(_present(value["type"]), _TYPE)["tensor_type"]), _TENSOR_TYPE)
        dims = [read(data, _DIM)["dim_value"] for data in read(_present(tensor["shape"]), _SHAPE)["dim"]]
    except ValueError as error:
        raise ValueError(f"{where} has no fixed shape: {error}") from error
    if tensor["elem_type"] != _FLOAT32 or not all(side is not None and 0 <= side <= _MAX_VALUES for side in dims):
        raise ValueError(f"{where} must be float32 of a fixed shape")
    return tuple(dims)


def _present(data: Any) -> memoryview:
    if not isinstance(data, memoryview):
        raise ValueError("its type is missing")
    return data


def _named(what: str, message: Message) -> str:
    name = message["name"]
    if not isinstance(name, str) or not is_name(name):
        raise ValueError(f"{what} is named {quoted(name)}: must be a short printable name")
    return name
