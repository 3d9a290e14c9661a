"""The simulation of a vehicle with an ECU: closed loop, campaigns, latency measurements, files of runs, and an emulated
microcontroller."""
