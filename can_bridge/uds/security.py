"""The security access (ISO 14229-1, service 0x27): shared secret, seeds, keys, wrong attempts and the delay after them.

Each security level has its own key: the AES-CMAC of a label and the level's number, computed with the shared key. The
answer to a seed is the AES-CMAC of the seed, computed with the level's key.

A seed is valid for one answer. An attempt is counted in non-volatile memory before the answer is checked, so that
nobody gets more attempts by switching off the supply. After `MAX_ATTEMPTS` consecutive wrong answers, and after each
further wrong answer, no seed is sent for `DELAY_NS`; a power-on restarts the delay.
"""

from collections.abc import Callable
from hmac import compare_digest
from pathlib import Path
from typing import Final, Self

from can_bridge.flashing.state import Level
from can_bridge.secoc.key import Key, read_secret
from can_bridge.uds.ecu_services import EcuServices
from can_bridge.uds.services import Nrc, Refused

SEED_LENGTH: Final = 16
ANSWER_LENGTH: Final = 16
"""Length in bytes of a seed, and of the tester's answer to it."""
MAX_ATTEMPTS: Final = 3
DELAY_NS: Final = 10_000_000_000
LABEL: Final = b"stillwake access"
"""Label before the level's number in the message whose AES-CMAC is the level's key."""


class AccessKey:
    """A 128-bit key for security access. Raises ValueError as `Key` does."""

    def __init__(self, secret: bytes) -> None:
        shared = Key(secret)
        self._levels = {level: Key(shared.cmac(LABEL + bytes([level]))) for level in Level}

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a key from a file of `stillwake keygen --secret`; raises KeyFileError as `read_secret` does."""
        return cls(read_secret(path))

    def answer(self, level: Level, seed: bytes) -> bytes:
        """Return the tester's answer that unlocks this level after this seed."""
        return self._levels[level].cmac(seed)


class SecurityAccess:
    """The unlocked level, and the procedure to unlock a level; `attempts` stores the numbers of wrong attempts."""

    def __init__(self, key: AccessKey, random_bytes: Callable[[int], bytes], attempts: EcuServices) -> None:
        self._key, self._random_bytes, self._attempts = key, random_bytes, attempts
        self.unlocked: Level | None = None
        self._asked: tuple[Level, bytes] | None = None
        self._closed_until_ns: dict[Level, int] = {}

    def power_on(self, now_ns: int) -> None:
        """Restart the delay of each level with too many wrong attempts, because the time without power is unknown."""
        for level in Level:
            if self._attempts.failed_attempts(level) >= MAX_ATTEMPTS:
                self._closed_until_ns[level] = now_ns + DELAY_NS

    def lock(self) -> None:
        self.unlocked = self._asked = None

    def seed(self, now_ns: int, level: Level) -> bytes:
        """Return a new seed, or zeros if the level is already unlocked. Raises Refused during the delay."""
        if self.unlocked is level:
            return bytes(SEED_LENGTH)
        self._asked = None
        if now_ns < self._closed_until_ns.get(level, now_ns):
            raise Refused(Nrc.DELAY_NOT_EXPIRED)
        seed = self._random_bytes(SEED_LENGTH)
        if not any(seed):
            raise Refused(Nrc.CONDITIONS_NOT_CORRECT, "the source of random bytes returns zeros")
        self._asked = level, seed
        return seed

    def unlock(self, now_ns: int, level: Level, answer: bytes) -> None:
        """Unlock the level for which the last seed was sent. Raises Refused for a wrong answer or another level."""
        if self._asked is None or self._asked[0] is not level:
            raise Refused(Nrc.SEQUENCE_ERROR)
        (_, seed), self._asked = self._asked, None
        count = self._attempts.failed_attempts(level) + 1
        self._attempts.keep_failed_attempts(level, count)
        if not compare_digest(self._key.answer(level, seed), answer):
            if count < MAX_ATTEMPTS:
                raise Refused(Nrc.INVALID_KEY)
            self._closed_until_ns[level] = now_ns + DELAY_NS
            raise Refused(Nrc.EXCEEDED_ATTEMPTS)
        self._attempts.keep_failed_attempts(level, 0)
        self.unlocked = level
