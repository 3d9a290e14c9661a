"""Seed and key of XCP, in pieces as short as its packets.

The keys are made as those of security access: 16 bytes that no trial finds, so there is no count of attempts; a wrong
key ends the connection, as the standard wants it.
"""

from collections.abc import Callable
from hmac import compare_digest
from typing import Final, Protocol

from can_bridge.calibration.xcp import CAL_PAG, MAX_CTO, Denied, Error
from can_bridge.flashing.access_level import Level

SEED_LENGTH: Final = 12
"""Bytes: two pieces. pyxcp's own unlocking fetches no third one (0.29), and no seed of UDS, which has 16 bytes, can be
had answered through XCP."""
KEY_LENGTH: Final = 16
"""Bytes of the answer: an AES-CMAC."""
_PIECE: Final = MAX_CTO - 2


class Access(Protocol):
    """What knows the secret: `can_bridge.uds.access_key.AccessKey`."""

    def answer(self, level: Level, seed: bytes) -> bytes:
        """The right key to a seed."""


class WrongKey(Exception):  # noqa: N818  (an answer of the tool's, no error of ours)
    """The connection ends."""


class XcpAccess:
    """Whether the resource is unlocked, and how far a tool is on the way there."""

    def __init__(self, access: Access, random_bytes: Callable[[int], bytes]) -> None:
        self._access = access
        self._random_bytes = random_bytes
        self.lock()

    @property
    def protected(self) -> int:
        """The resources that are locked."""
        return 0 if self.is_unlocked else CAL_PAG

    def lock(self) -> None:
        """At the beginning and at the end of a connection."""
        self.is_unlocked = False
        self._forget()

    def seed(self, mode: int, resource: int) -> bytes:
        """The bytes left of the seed, as one number, and the next of them; no bytes if nothing is locked. Raises Denied
        for another resource or mode, or for the rest of a seed that was not asked for."""
        if mode == 0:
            self._forget()
            if resource != CAL_PAG:
                raise Denied(Error.OUT_OF_RANGE)
            if self.is_unlocked:
                return bytes([0])
            self._seed = self._unsent = self._random_bytes(SEED_LENGTH)
        elif mode != 1:
            raise Denied(Error.OUT_OF_RANGE)
        elif not self._unsent:
            raise Denied(Error.SEQUENCE)
        left, piece = len(self._unsent), self._unsent[:_PIECE]
        self._unsent = self._unsent[_PIECE:]
        return bytes([left]) + piece

    def unlock(self, left: int, data: bytes) -> None:
        """The next bytes of the key, of which `left` are to come, these included. Raises Denied if no whole seed was
        fetched, or a piece is missing; WrongKey if it is; another try needs another seed."""
        if not self._seed or self._unsent or left != KEY_LENGTH - len(self._key):
            self._forget()
            raise Denied(Error.SEQUENCE)
        piece = data[: min(left, _PIECE)]
        if len(piece) < min(left, _PIECE):
            raise Denied(Error.CMD_SYNTAX)
        self._key += piece
        if len(self._key) == KEY_LENGTH:
            right = compare_digest(self._access.answer(Level.CALIBRATION, self._seed), self._key)
            self._forget()
            if not right:
                raise WrongKey
            self.is_unlocked = True

    def _forget(self) -> None:
        self._seed = self._unsent = self._key = b""
