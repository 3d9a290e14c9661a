"""What an engineer does at a bus: watch, record, replay, send, decode."""
