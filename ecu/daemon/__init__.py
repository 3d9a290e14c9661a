"""The ECU as a process on a vehicle's computer: reconnection to a bus, signals, a watchdog, a log and counters."""
