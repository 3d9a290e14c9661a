"""A whole board with an emulated Cortex-M7: its firmware runs from reset and uses only registers and memories."""
