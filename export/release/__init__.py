"""The export of a model folder as a release: the program is converted to ONNX and C, checked, and written."""
