"""The store's verdict on a release: why it is taken, or which check it failed.

On the wire each is a byte in the answer to the routine that checks an image (`can_bridge.uds.services`).
"""

from enum import IntEnum


class Verdict(IntEnum):
    """The checks in the order in which they are made; the first one that fails is the verdict."""

    GOOD = 0
    INCOMPLETE = 1
    """Bytes of the announced image are missing."""
    WRONG_HASH = 2
    """The image is not the announced one: damaged on the way, or in the memory."""
    DAMAGED = 3
    """No image of a bundle, or one whose manifest, files or graphs are not in order."""
    UNSIGNED = 4
    BAD_SIGNATURE = 5
    UNKNOWN_KEY = 6
    """Signed by a key that the key list does not allow."""
    REVOKED_KEY = 7
    """Signed by a key that the key list revokes."""
    WRONG_DBC = 8
    WRONG_HARDWARE = 9
    WRONG_PERIOD = 10
    WRONG_VEHICLE = 11
    """Another operating point, action limit or number of sensors."""
    TOO_OLD = 12
    """Its security version is below that of a release that was confirmed here."""
    UNREADABLE = 13
    """The memory does not give it back."""
    EMPTY = 14
    """Nothing is in the slot."""
    WRONG_BUILD = 15
    """Its numbers are laid out for another firmware, judged right after WRONG_DBC; or its payload is too short or has a
    number that no ECU can run, judged last."""

    @property
    def in_words(self) -> str:
        return _WORDS[self]


_WORDS = {
    Verdict.GOOD: "in order",
    Verdict.INCOMPLETE: "bytes of the image are missing",
    Verdict.WRONG_HASH: "the image is not the one that was announced: its SHA-256 differs",
    Verdict.DAMAGED: "the image is no bundle in order",
    Verdict.UNSIGNED: "the bundle is not signed",
    Verdict.BAD_SIGNATURE: "the bundle's signature is not good",
    Verdict.UNKNOWN_KEY: "the bundle is signed by a key that this ECU does not know",
    Verdict.REVOKED_KEY: "the bundle is signed by a key that was revoked",
    Verdict.WRONG_DBC: "the bundle was made for another stillwake.dbc",
    Verdict.WRONG_HARDWARE: "the bundle was made for other ECU hardware",
    Verdict.WRONG_PERIOD: "the bundle was made for another control period",
    Verdict.WRONG_VEHICLE: "the bundle was made for another vehicle",
    Verdict.TOO_OLD: "the bundle's security version is older than this ECU allows",
    Verdict.UNREADABLE: "the memory does not give the image back",
    Verdict.EMPTY: "the slot is empty",
    Verdict.WRONG_BUILD: "the image was made for another build of the firmware, or has numbers that no ECU can run",
}
