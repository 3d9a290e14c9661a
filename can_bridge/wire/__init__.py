"""The frames of a bus: the DBC's messages as values and as bytes, and the number and time of a frame's bits."""
