"""The export of a trained model: controller program, NumPy reference, ONNX and C99 (float32, int8), gates, releases."""
