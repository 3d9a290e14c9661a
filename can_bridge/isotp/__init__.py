"""ISO-TP, messages longer than a frame (ISO 15765-2): the ECU's side. Testers use the library can-isotp."""
