"""The files of recorded CAN traffic: functions that write and read them."""
