"""The security levels of diagnosis: the store counts failed attempts for each, and the UDS server asks for its key."""

from enum import IntEnum


class Level(IntEnum):
    """Security levels; the value is the sub-function that requests the level's seed."""

    PROGRAMMING = 0x01
    CALIBRATION = 0x03
