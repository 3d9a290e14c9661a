"""The rounding of weights to integers, and the calibration of this rounding with recorded windows."""
