"""Seeded faults of a CAN bus that wrap any `can_bridge.bus.interface.Bus`, one family a file.

A fault is a frozen dataclass of what happens and when (`fault.py`); its injector is a bus around a bus
(`injector.py`). `wrapping.py` puts several around one port, `text.py` reads them from a line of text.
"""
