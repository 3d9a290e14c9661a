"""The export of a trained model: reference in NumPy, ONNX graph and C99 library (float32, int8), checks, releases."""
