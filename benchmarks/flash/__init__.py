"""The proof of flashing: the supply cut at every write, and again during the recovery."""
