"""An ECU that can be flashed and calibrated: boot, control steps, and the services a tester asks for."""
