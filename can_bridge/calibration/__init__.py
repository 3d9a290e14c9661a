"""The ECU's side of calibration with a measurement tool: a memory segment, XCP on CAN, an A2L file."""
