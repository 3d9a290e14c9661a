"""The FMUs for co-simulation in other tools: one with the ECU in C, one with the plant."""
