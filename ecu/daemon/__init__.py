"""The ECU as a process on a vehicle's computer: a bus that may come and go, signals, a watchdog, a log, counters."""
