"""Real, virtual and simulated buses with one interface, and the parts of a node that receive from a bus."""
