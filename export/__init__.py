"""Trained model -> controller program -> {NumPy reference, ONNX, C99}, float32 or int8; gates; the release writer."""
