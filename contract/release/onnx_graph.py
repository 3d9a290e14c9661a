"""What no graph of a bundle may hold, whoever signed it: its bytes are judged before ONNX Runtime sees them.

A graph may come from anyone. ONNX Runtime refuses operators that it does not know, other inputs, outputs and shapes
are refused where its session is opened, and a first step runs in bounded time and memory (`contract.runtime`). What is
left are constants in other files and operators that are not ONNX's own. Both have a text in the file, wherever in the
graph they stand, and no export writes one with it. Whoever signs a graph judges it more strictly
(`export.release.judged`).
"""

from typing import Final

MAX_GRAPH_BYTES: Final = 16 * 2**20
"""Size of the file: a hundred times the paper's controller in int8."""
FORBIDDEN: Final = {
    b"location": "a constant is kept in another file: must be in this one",
    b"com.microsoft": "an operator is of ONNX Runtime's own domain: must be one of ONNX's",
    b"ai.onnx.": "an operator is of another domain than ONNX's first: must be of that",
}
"""Texts that stand in no sound graph, and what they mean. An external tensor names its file by the key `location`."""


def check_graph(content: bytes) -> None:
    """Raise ValueError for a file that is too large, reads others, or has operators that are not ONNX's own."""
    if len(content) > MAX_GRAPH_BYTES:
        raise ValueError(f"it has {len(content)} bytes: at most {MAX_GRAPH_BYTES}")
    for text, wording in FORBIDDEN.items():
        if text in content:
            raise ValueError(wording)
