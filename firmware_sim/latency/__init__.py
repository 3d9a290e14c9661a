"""Measurement of the latency of a loop in real time: its stages, an idle loop for comparison in the same run, and a
budget."""
