"""The real, virtual and simulated buses with a common interface, and the code with which a node receives frames."""
