"""The bus: wire format, end-to-end protection, the command gate and the adapters to real and virtual buses."""
