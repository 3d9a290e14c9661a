"""Facts every room shares: geometry, sensors, units, configuration, dataset and bundle formats, the DBC."""
