"""Buses behind one interface, and what receives from them."""
