"""The execution of a bundle's graphs by ONNX Runtime in bounded time and memory, and rules for copying objects with
state."""
