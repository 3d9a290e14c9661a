"""An engineer's tools for a bus: watch, record, replay, send, decode, convert logs to data sets. Some tools need the
extra `bus`."""
