"""The controller's C library on an emulated Cortex-M7: memory, instructions, a modelled time, the host's numbers."""
