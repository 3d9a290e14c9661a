"""A whole board with an emulated Cortex-M7. Its firmware runs from reset and accesses only registers and memories."""
