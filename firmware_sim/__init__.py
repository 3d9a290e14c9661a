"""A simulated vehicle around an ECU: closed loop, campaigns, latency, files of runs, emulated microcontroller."""
