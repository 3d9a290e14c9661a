"""The contents of the bus: frames, the DBC's messages as values and as bytes, and the time of frames on the bus."""
