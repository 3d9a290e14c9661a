"""The CAN bus: wire format, end-to-end protection, the command gate, and adapters to real and virtual buses."""
