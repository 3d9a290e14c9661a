"""Seeded faults of a CAN bus that wrap any `can_bridge.bus.interface.Bus`, one family a file.

A fault is a frozen dataclass that states what happens and when. An injector is a bus with one fault around another bus
(`fault.py`). `text.py` reads faults from a line of text.
"""
