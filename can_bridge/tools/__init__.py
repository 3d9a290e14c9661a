"""An engineer's tools for a bus: watch, record, replay, send, decode, convert logs. Some need the extra `bus`."""
