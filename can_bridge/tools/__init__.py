"""What an engineer does at a bus: watch, record, replay, send, decode, make data of logs. Some needs extra `bus`."""
