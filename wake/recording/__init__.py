"""The recording of data sets: jet signals, episodes in blocks, parallel work, and recording under a controller."""
