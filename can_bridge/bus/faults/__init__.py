"""Faults of a CAN bus, reproducible by a seed. The faults act on any bus with the interface
`can_bridge.bus.interface.Bus`; each file has one family of faults.

A fault is a frozen dataclass that states the effect and its time span. An injector is a bus that forwards all calls to
another bus and applies one fault (`fault.py`). `text.py` reads faults from a line of text.
"""
