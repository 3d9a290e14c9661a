"""The export of a trained model: controller program, NumPy reference, ONNX and C99 in float32 or int8, gates, release
writer."""
