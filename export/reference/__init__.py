"""The specification: a control step in NumPy float64, with its hand-written adjoint."""
