"""The closed loop of an ECU and a simulated vehicle, campaigns and latency runs, the files of a run, and an emulated
microcontroller."""
