"""What the bus is worth: codec, protection, response times, reception under fire, command gate."""
