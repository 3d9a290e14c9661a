"""The faults of any `can_bridge.bus.interface.Bus`, reproducible by a seed; each file has one family of faults."""
