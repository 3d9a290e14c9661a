"""What runs a released controller: its interface, ONNX Runtime, and the C library on this machine."""
