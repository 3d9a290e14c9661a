"""The vehicle's side of a bus in real time: it sends pressures from a recording or a live wake, and drives the jets as
commanded."""
