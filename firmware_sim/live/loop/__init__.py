"""The loop of a live session: its periods, its switched disturbances, its events and messages."""
