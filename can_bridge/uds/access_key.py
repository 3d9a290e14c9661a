"""The secret that tester and ECU share, and the answers to seeds that are made with it.

Each security level has a key of its own, AES-CMAC of the shared key over a label and the level's number, so that an
answer for one level is none for another. The answer to a seed is AES-CMAC of the level's key over the seed.
"""

from pathlib import Path
from typing import Final, Self

from can_bridge.flashing.access_level import Level
from can_bridge.secoc.key import Key, read_key

SEED_LENGTH: Final = 16
ANSWER_LENGTH: Final = 16
"""Bytes of a seed, and of the key that the tester sends for it."""
LABEL: Final = b"stillwake access"
"""What a level's key is made over, with the level's number."""


class AccessKey:
    """A 128-bit key for security access, ready for use. Raises ValueError as `Key` does."""

    def __init__(self, secret: bytes) -> None:
        self._take(Key(secret))

    @classmethod
    def read(cls, path: Path) -> Self:
        """From a file as `stillwake keygen --secret` writes it; raises KeyFileError as `read_key` does."""
        made = cls.__new__(cls)
        made._take(read_key(path))
        return made

    def answer(self, level: Level, seed: bytes) -> bytes:
        """What unlocks this level after this seed."""
        return self._levels[level].cmac(seed)

    def _take(self, key: Key) -> None:
        self._levels = {level: Key(key.cmac(LABEL + bytes([level]))) for level in Level}
