"""The security levels of diagnosis. Each level has its own key, and the store counts failed attempts for each level."""

from enum import IntEnum


class Level(IntEnum):
    """A security level; the value is the sub-function that requests the level's seed."""

    PROGRAMMING = 0x01
    CALIBRATION = 0x03
