"""Messages longer than a frame (ISO 15765-2): the ECU's side; testers use the library can-isotp."""
