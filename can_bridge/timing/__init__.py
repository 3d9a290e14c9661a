"""Messages in time: periodic traffic, worst-case response times, the load of a bus."""
