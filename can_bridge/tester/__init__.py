"""The tester's side of diagnosis, with which a workshop or a fleet flashes and calibrates an ECU (extra `flash`)."""
