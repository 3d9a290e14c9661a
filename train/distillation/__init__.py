"""The distillation of smaller networks from larger networks, and the evaluation of the smaller networks."""
