"""Smaller networks from larger ones, and how they are judged."""
