"""Trained model -> controller program -> {NumPy reference, ONNX float, ONNX int8}; parity gates; bundle writer."""
