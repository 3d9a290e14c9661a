"""A simulated closed loop: the vehicle's side of the bus, the loop in virtual time, and the code that sets up a run."""
