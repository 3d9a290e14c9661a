"""An engineer's tools for a bus: watch, record, replay, send, decode, convert logs to data. Some need extra `bus`."""
