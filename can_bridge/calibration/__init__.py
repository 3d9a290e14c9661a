"""What a measurement tool needs to read and write the calibration: a memory segment, XCP on CAN, an A2L file."""
