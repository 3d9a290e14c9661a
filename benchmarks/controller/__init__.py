"""Measurements of the controller, of its implementations, and of the plant's time step, and tables of their results."""
