"""Seeded faults of a CAN bus that wrap any `can_bridge.bus.interface.Bus`, one family a file.

A fault is a frozen dataclass of what happens and when; an injector is a bus around a bus with one fault (`fault.py`).
`text.py` reads faults from a line of text.
"""
