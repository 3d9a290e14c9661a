"""What is on the wire: frames, the DBC's messages as values, their bytes, and how long they take."""
