"""The software of the ECU in a vehicle: control steps, fail-safe and checks. It does not need the package `wake`."""
