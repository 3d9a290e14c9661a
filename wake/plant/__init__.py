"""The definitions that all plants share: the protocols, the measurements at an instant, and the wind."""
