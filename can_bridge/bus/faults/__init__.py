"""The faults that can be applied to any `can_bridge.bus.interface.Bus`. A seed makes them reproducible."""
