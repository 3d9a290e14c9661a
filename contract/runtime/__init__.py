"""The execution of a bundle's graphs by ONNX Runtime, and rules for copying stateful objects."""
