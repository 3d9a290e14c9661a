"""The C library on an emulated Cortex-M7: memory, instructions, modelled time, and a comparison with this host."""
