"""The simulation of a vehicle with an ECU: closed loop, campaigns, latency, files of runs, emulated microcontroller."""
