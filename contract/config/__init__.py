"""The tree of all settings, built from frozen dataclasses, and the functions that read it."""
