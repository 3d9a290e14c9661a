"""The tester's side of diagnosis: what a workshop or a fleet uses to flash and to calibrate an ECU (extra `flash`)."""
