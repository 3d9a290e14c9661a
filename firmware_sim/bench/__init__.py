"""The closed loop: the vehicle's side, virtual time, and the wiring of a run."""
