"""A whole board around an emulated Cortex-M7: its firmware runs from the reset vector, and sees registers alone."""
