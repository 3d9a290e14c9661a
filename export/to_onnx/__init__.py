"""The program as one ONNX graph of standard operators."""
