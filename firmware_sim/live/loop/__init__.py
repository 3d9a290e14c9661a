"""The loop of a live session: its periods, the disturbances that viewers switch on and off, events and messages."""
