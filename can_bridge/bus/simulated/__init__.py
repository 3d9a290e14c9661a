"""A CAN bus in virtual time: the medium, its ports, arbitration and fault confinement."""
