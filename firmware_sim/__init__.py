"""The ECU, the vehicle around it, the closed loop, what a run leaves behind, and an emulated microcontroller."""
