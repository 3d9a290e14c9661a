"""Distillation of smaller networks from larger ones, and their evaluation."""
