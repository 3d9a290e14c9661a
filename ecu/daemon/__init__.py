"""The ECU as a process on a vehicle's computer: a bus that may disconnect, signals, a watchdog, a log, counters."""
