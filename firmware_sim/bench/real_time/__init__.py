"""The vehicle's side of a bus in real time: pressures from a recording or a live wake, jets as commanded."""
