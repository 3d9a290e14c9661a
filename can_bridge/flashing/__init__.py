"""The store of an ECU's releases, with two slots."""
