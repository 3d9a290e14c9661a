"""FMI 3.0: the ECU in C, and the plant, as FMUs for co-simulation in other tools."""
