"""An engineer's tools for a bus: watch, record, replay, send, decode, convert logs to data. Some tools need the extra
`bus`."""
