"""The latency of a loop in real time: its stages, an idle loop in the same run, and a budget."""
