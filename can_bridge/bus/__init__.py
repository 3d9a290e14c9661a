"""Real, virtual and simulated buses with one interface, and the parts with which a node receives frames."""
