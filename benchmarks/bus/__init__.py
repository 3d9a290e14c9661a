"""Measurements of frames, protection and buses."""
