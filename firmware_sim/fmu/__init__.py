"""FMUs for co-simulation in other tools: the ECU in C, and the plant."""
