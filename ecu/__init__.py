"""What a vehicle installs: the ECU, its fail-safe, its window, and what runs a release in it. Sees no wake."""
