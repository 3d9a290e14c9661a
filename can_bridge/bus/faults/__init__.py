"""Faults of a CAN bus, reproducible by a seed. They wrap any `can_bridge.bus.interface.Bus`; each file has one family
of faults.

A fault is a frozen dataclass that states the effect and its time span. An injector is a bus that applies one fault to
another bus (`fault.py`). `text.py` reads faults from a line of text.
"""
