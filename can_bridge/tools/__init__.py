"""What an engineer does at a bus: watch, record, replay, send, decode; turn logs into data. Some needs the extra `bus`."""
