"""The loop of a live session: its periods, the disturbances that viewers switch, its events and messages."""
