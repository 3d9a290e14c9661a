"""The controller's C library on an emulated Cortex-M7: its memory, instructions and modelled time, and its agreement
with this host."""
