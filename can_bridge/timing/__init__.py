"""The timing of messages: periodic traffic, worst-case response times, the load of a bus."""
