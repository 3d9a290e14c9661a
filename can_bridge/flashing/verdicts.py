"""The store's verdict on a release: GOOD, or the check that it failed."""

from enum import IntEnum
from typing import Self


class InWords(IntEnum):
    """A number that diagnosis sends in one byte; `in_words` is its text for people."""

    in_words: str

    def __new__(cls, value: int, in_words: str = "") -> Self:
        made = int.__new__(cls, value)
        made._value_, made.in_words = value, in_words
        return made


class Verdict(InWords):
    """The results of the checks of a release. The first failed check determines the verdict."""

    GOOD = 0, "in order"
    INCOMPLETE = 1, "bytes of the image are missing"
    WRONG_HASH = 2, "the image is not the announced image: its SHA-256 differs"
    DAMAGED = 3, "the image is not a valid bundle"
    """The image has no bundle, or the bundle's manifest, one of its files or one of its graphs is invalid."""
    UNSIGNED = 4, "the bundle is not signed"
    BAD_SIGNATURE = 5, "the bundle's signature is invalid"
    UNKNOWN_KEY = 6, "the bundle is signed by a key that is not in this ECU's list"
    REVOKED_KEY = 7, "the bundle is signed by a key that was revoked"
    WRONG_DBC = 8, "the bundle was made for another stillwake.dbc"
    WRONG_HARDWARE = 9, "the bundle was made for other ECU hardware"
    WRONG_PERIOD = 10, "the bundle was made for another control period"
    WRONG_VEHICLE = 11, "the bundle was made for another vehicle"
    """The bundle's operating point, action limit or number of sensors differs from the vehicle's value."""
    TOO_OLD = 12, "the bundle's security version is older than this ECU allows"
    UNREADABLE = 13, "the image cannot be read back from the memory"
    EMPTY = 14, "the slot is empty"
    WRONG_BUILD = 15, "the image was made for another build of the firmware, or has numbers that no ECU accepts"
    """The image's parameters have the layout of another firmware (checked right after WRONG_DBC), or its payload is too
    short or has a number that no ECU accepts (checked last)."""
