"""The export of a model folder as a release: the program is converted to ONNX and C, the results are checked, and files
are written."""
