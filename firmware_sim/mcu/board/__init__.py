"""A whole board with an emulated Cortex-M7: its firmware runs from the reset vector and accesses only registers and
memories."""
