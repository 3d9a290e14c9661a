"""The ECU in virtual time, the vehicle around it, the closed loop and its report."""
