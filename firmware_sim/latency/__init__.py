"""The measurement of a loop's latency in real time: its stages, an idle loop for comparison, and a budget."""
