"""Who may do what through diagnosis: the store counts failed attempts by level, and the UDS server asks for keys."""

from enum import IntEnum


class Level(IntEnum):
    """Security levels, by the sub-function that asks for their seed."""

    PROGRAMMING = 0x01
    CALIBRATION = 0x03
