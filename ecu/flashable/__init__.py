"""An ECU that can be flashed and calibrated: boot, control steps, and the services for a tester."""
