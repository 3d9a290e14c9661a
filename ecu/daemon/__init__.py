"""The ECU as a process on a vehicle's computer. The process handles a bus that may disconnect, signals, a watchdog, a
log and counters."""
