"""The closed loop: the vehicle's side, virtual time, and the assembly of a run."""
