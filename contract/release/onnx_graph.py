"""Content that is forbidden in a bundle's graphs; the bytes are checked before ONNX Runtime reads them.

A graph may come from anyone. ONNX Runtime refuses unknown operators. Opening the graph's session refuses other inputs,
outputs and shapes, and a first step runs in bounded time and memory (`contract.runtime`). Two kinds of content remain,
which this module refuses: constants in other files, and operators that are not ONNX's own. Each of them puts a certain
text somewhere into the file, and no exported graph contains this text. When a graph is signed, it is checked more
strictly (`export.release.judged`).
"""

from typing import Final

MAX_GRAPH_BYTES: Final = 16 * 2**20
"""Largest size of a graph's file, in bytes: a hundred times the paper's controller in int8."""
FORBIDDEN: Final = {
    b"location": "a constant is in another file: must be in this file",
    b"com.microsoft": "an operator is of ONNX Runtime's domain: must be an operator of ONNX",
    b"ai.onnx.": "an operator is not of ONNX's default domain: must be of this domain",
}
"""Texts that no valid graph contains, and their meanings. A tensor in another file has the key `location`."""


def check_graph(content: bytes) -> None:
    """Raise ValueError for a graph that is too large, refers to other files, or has operators other than ONNX's own."""
    if len(content) > MAX_GRAPH_BYTES:
        raise ValueError(f"it has {len(content)} bytes: at most {MAX_GRAPH_BYTES}")
    for text, wording in FORBIDDEN.items():
        if text in content:
            raise ValueError(wording)
