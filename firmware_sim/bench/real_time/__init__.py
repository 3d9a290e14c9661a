"""The vehicle's side of a bus in real time, with pressures from a recording or a live wake."""
