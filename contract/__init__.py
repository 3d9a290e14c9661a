"""Definitions and formats that all packages share: geometry, sensors, units, configuration, data sets, bundles, the
DBC."""
