"""Security levels of diagnosis: the store counts failed attempts by level, and the UDS server asks for keys."""

from enum import IntEnum


class Level(IntEnum):
    """Security levels; the value is the sub-function that requests the level's seed."""

    PROGRAMMING = 0x01
    CALIBRATION = 0x03
