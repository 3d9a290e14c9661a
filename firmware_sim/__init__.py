"""A simulated vehicle around an ECU: closed loop, campaigns, latency measurement, files of runs, emulated
microcontroller."""
