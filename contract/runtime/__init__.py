"""The execution of a bundle's graphs by ONNX Runtime, and rules for copying objects with state."""
