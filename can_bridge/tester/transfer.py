"""Bringing an image into an ECU: announce, send from where it is wanted, check; begun again where it was interrupted.

Whatever interrupts a transfer, be it lost frames, a session that ended or an ECU that lost its supply, the next attempt
begins with a new session and a new announcement, whose answer has the byte from which on the image is wanted.
"""

import hashlib
import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from can_bridge.flashing.access_level import Level
from can_bridge.flashing.verdicts import Verdict
from can_bridge.tester.asking import Asking
from can_bridge.tester.messages import ImageRefusedError, LostError, NoAnswerError, RefusedError, WrongKeysError
from can_bridge.uds.services import MAX_BLOCK, Did, Nrc, Routine, Session
from contract.errors import FlashError

BLOCK_STEP: Final = 32
"""Blocks begin at multiples of this, a word of flash memory."""
_HEADER: Final = 2
_IN_A_ROW: Final = 16
"""Blocks that arrive at once before a longer one is tried."""


class BlockLength:
    """The length of one image's blocks, over all attempts to transfer it."""

    def __init__(self) -> None:
        self._longest = self._limit = (MAX_BLOCK - _HEADER) // BLOCK_STEP * BLOCK_STEP
        self._good = 0

    def allow(self, longest_request: int) -> None:
        """What the ECU takes in one request, in bytes."""
        self._limit = max(BLOCK_STEP, (min(longest_request, MAX_BLOCK) - _HEADER) // BLOCK_STEP * BLOCK_STEP)

    def next_from(self, offset: int) -> int:
        """Bytes of a block that begins at this offset of the image."""
        return min(self._longest, self._limit) - offset % BLOCK_STEP

    def arrived(self) -> None:
        """A block did at once."""
        self._good += 1
        if self._good >= _IN_A_ROW:
            self._good = 0
            self._longest = min(2 * self._longest, self._limit)

    def lost(self) -> None:
        """A block was, or its answer."""
        self._good = 0
        self._longest = max(BLOCK_STEP, self._longest // 2 // BLOCK_STEP * BLOCK_STEP)


OnProgress = Callable[[int, int], None]
"""Called with the bytes that the ECU has, and those of the image."""

STALLS: Final = 5
"""Attempts in a row of which none brought a byte further, after which it is given up."""
TRIES: Final = 3
"""Tries of a step that is begun again because its session ended: the ECU fell silent for long, or lost its supply."""
SESSION_ENDED: Final = frozenset(
    {Nrc.SERVICE_NOT_IN_SESSION, Nrc.SUB_FUNCTION_NOT_IN_SESSION, Nrc.SECURITY_ACCESS_DENIED}
)
STARTING_S: Final = 15.0
"""The wait for an ECU that may be starting."""

_AGAIN: Final = SESSION_ENDED | frozenset(
    {
        Nrc.SEQUENCE_ERROR,
        Nrc.UPLOAD_DOWNLOAD_NOT_ACCEPTED,
        Nrc.TRANSFER_SUSPENDED,
        Nrc.PROGRAMMING_FAILURE,
        Nrc.WRONG_BLOCK_COUNTER,
        # A routine or download in a session that ended meanwhile.
        Nrc.OUT_OF_RANGE,
        Nrc.CONDITIONS_NOT_CORRECT,
    }
)
_DAMAGED_ON_THE_WAY: Final = frozenset({Verdict.INCOMPLETE, Verdict.WRONG_HASH, Verdict.UNREADABLE})
_ANNOUNCEMENT: Final = struct.Struct(">I32s")
_COUNTERS: Final = 256


@dataclass(frozen=True, kw_only=True)
class Transferred:
    """How it went.

    Attributes:
        resumed_from: bytes that the ECU had from before.
        attempts: announcements that it took.
    """

    resumed_from: int
    attempts: int


class Transfer:
    """One image's way into an ECU."""

    def __init__(self, asking: Asking, image: bytes, progress: OnProgress) -> None:
        self._asking = asking
        self._image = image
        self._progress = progress
        self._lengths = BlockLength()
        self._received = 0

    def run(self) -> Transferred:
        """Go on until the ECU has the image and its verdict is good; it is in the programming session then, and
        unlocked.

        Raises:
            ImageRefusedError: the verdict is not.
            LostError: the ECU no longer answers.
            RefusedError, NotNowError, AccessError: as the ECU answers.
        """
        resumed_from, attempts, stalls = 0, 0, 0
        while True:
            attempts, before = attempts + 1, self._received
            try:
                offset = self.announce()
                resumed_from = offset if attempts == 1 else resumed_from
                self._received = offset
                self._progress(offset, len(self._image))
                verdict = self._bring(offset)
                if verdict is Verdict.GOOD:
                    return Transferred(resumed_from=resumed_from, attempts=attempts)
                failure: FlashError = ImageRefusedError(verdict)
                if verdict not in _DAMAGED_ON_THE_WAY:
                    raise failure
            except RefusedError as refused:
                if refused.code not in _AGAIN:
                    raise
                failure = refused
            except NoAnswerError:
                failure = LostError(self._received, len(self._image))
                self._wait_for(failure)
            stalls = 0 if self._received > before else stalls + 1
            if stalls >= STALLS:
                raise failure

    def announce(self) -> int:
        """Announce in a new session which image comes; the offset from which it is wanted."""
        enter_programming(self._asking)
        option = _ANNOUNCEMENT.pack(len(self._image), hashlib.sha256(self._image).digest())
        answer = self._asking.routine(Routine.ERASE, option)
        offset = int.from_bytes(answer[:4], "big")
        if len(answer) != 4 or offset > len(self._image):
            raise RefusedError("name the byte from which it wants the image", Nrc.OUT_OF_RANGE)
        return offset

    def _bring(self, offset: int) -> Verdict:
        if offset < len(self._image):
            self._lengths.allow(self._asking.download(offset, len(self._image) - offset))
            self._send(offset)
            self._asking.exit()
        answer = self._asking.routine(Routine.CHECK)
        return Verdict(answer[0]) if answer and answer[0] in Verdict.__members__.values() else Verdict.DAMAGED

    def _send(self, offset: int) -> None:
        counter = 1
        while offset < len(self._image):
            block = self._image[offset : offset + self._lengths.next_from(offset)]
            unanswered = self._asking.unanswered
            try:
                self._asking.transfer(counter, block)
            except NoAnswerError:
                self._lengths.lost()
                raise
            finally:
                for _ in range(self._asking.unanswered - unanswered):
                    self._lengths.lost()
            if self._asking.unanswered == unanswered:
                self._lengths.arrived()
            counter = (counter + 1) % _COUNTERS
            offset += len(block)
            self._received = offset
            self._progress(offset, len(self._image))

    def _wait_for(self, failure: FlashError) -> None:
        try:
            self._asking.wait_until_there(STARTING_S, "answer")
        except NoAnswerError:
            raise failure from None


def enter_programming(asking: Asking) -> None:
    """Begin the programming session and unlock it, again if the ECU restarts in between."""
    for left in reversed(range(TRIES)):
        asking.session(Session.PROGRAMMING)
        try:
            asking.unlock(Level.PROGRAMMING)
            return
        except RefusedError as refused:
            if refused.code not in SESSION_ENDED or not left:
                raise


def in_programming(asking: Asking, routine: Routine) -> None:
    """Run a routine in the programming session, which is begun again if it ended by itself."""
    for left in reversed(range(TRIES)):
        try:
            asking.routine(routine)
            return
        except RefusedError as refused:
            if refused.code not in SESSION_ENDED or not left:
                raise
        enter_programming(asking)


def bring(asking: Asking, raw: bytes) -> tuple[int, int]:
    """Replace the key list; returns the version of the one before, 0 without one, and of the new one. Raises
    WrongKeysError if the ECU does not take it; FlashError if not now, or it does not answer."""
    before = _version(asking)
    enter_programming(asking)
    try:
        asking.write(Did.KEY_LIST, raw)
    except RefusedError as refused:
        if refused.code != Nrc.OUT_OF_RANGE:
            raise
        raise WrongKeysError(
            f"the ECU refused the key list: it must be signed by the ECU's root key, have a version above {before}, "
            "and keep the key that signed the confirmed release"
        ) from refused
    after = _version(asking)
    asking.session(Session.DEFAULT)
    return before, after


def _version(asking: Asking) -> int:
    return int.from_bytes(asking.read(Did.KEY_LIST), "big")
