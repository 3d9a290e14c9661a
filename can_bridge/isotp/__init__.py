"""ISO-TP (ISO 15765-2), for messages longer than a frame: the ECU's side. Testers use the library can-isotp."""
