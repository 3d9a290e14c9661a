"""The ECU's side of ISO-TP (ISO 15765-2), for messages longer than a frame. Testers use the library can-isotp."""
