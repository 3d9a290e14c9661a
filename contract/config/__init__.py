"""The tree of all settings, and the functions that read this tree from files. The settings are frozen dataclasses."""
