"""What runs the graphs of a release bundle: ONNX Runtime within bounds; and how what runs is copied."""
