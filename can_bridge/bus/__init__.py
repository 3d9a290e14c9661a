"""The real, virtual and simulated buses behind one interface, faults of a bus, and a report on unusable frames."""
