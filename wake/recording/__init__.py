"""The recording of data sets: jet signals, episodes in blocks, parallel recording, and recording under a controller."""
