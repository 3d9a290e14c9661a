"""The loop of a live session: its control periods, the disturbances that viewers switch on and off, its events and its
messages."""
