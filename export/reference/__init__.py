"""The specification of a control step: an implementation in NumPy float64, with a hand-written adjoint."""
