"""The execution of a release bundle's graphs: ONNX Runtime with bounded time and memory. Rules for copying such objects
are here too."""
