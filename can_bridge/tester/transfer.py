"""The transfer of an image to an ECU: announce the image, send it from the byte that the ECU requests, and check it.

After any interruption, such as lost frames, a session that ended or a loss of power, the next attempt begins with a new
session and a new announcement. The answer to the announcement states the byte from which the image is to be sent.
"""

import hashlib
from collections.abc import Callable
from typing import Final

from can_bridge.flashing.state import Level
from can_bridge.flashing.verdicts import Verdict
from can_bridge.tester import messages
from can_bridge.tester.asking import Asking
from can_bridge.tester.messages import NoAnswerError, RefusedError
from can_bridge.uds.services import MAX_BLOCK, Did, Nrc, Routine, Session
from contract.errors import FlashError
from contract.release import key_list

BLOCK_STEP: Final = 32
"""Size in bytes of a word of flash memory. The offset of every block after the first is a multiple of this size."""
_HEADER: Final = 2
_IN_A_ROW: Final = 16
"""Number of consecutive blocks that must arrive at the first attempt before a longer block is sent."""


class BlockLength:
    """The length of the blocks in which one image is sent. All attempts to transfer the image use one object."""

    def __init__(self) -> None:
        self._longest = self._limit = (MAX_BLOCK - _HEADER) // BLOCK_STEP * BLOCK_STEP
        self._good = 0

    def allow(self, longest_request: int) -> None:
        """Set the length in bytes of the largest transfer request that the ECU accepts."""
        self._limit = max(BLOCK_STEP, (min(longest_request, MAX_BLOCK) - _HEADER) // BLOCK_STEP * BLOCK_STEP)

    def next_from(self, offset: int) -> int:
        """Return the length in bytes of the block that begins at this offset of the image."""
        return min(self._longest, self._limit) - offset % BLOCK_STEP

    def arrived(self) -> None:
        """Count a block that arrived at the first attempt."""
        self._good += 1
        if self._good >= _IN_A_ROW:
            self._good = 0
            self._longest = min(2 * self._longest, self._limit)

    def lost(self) -> None:
        """Shorten the blocks, because a block or the answer to it was lost."""
        self._good = 0
        self._longest = max(BLOCK_STEP, self._longest // 2 // BLOCK_STEP * BLOCK_STEP)


OnProgress = Callable[[int, int], None]
"""A function that is called with the number of bytes that the ECU has, and the length of the image."""

STALLS: Final = 5
"""Largest number of consecutive attempts to transfer an image in which the ECU receives no further bytes."""
TRIES: Final = 3
"""Largest number of attempts at a step. A step is repeated if the session ended during the step."""
_SESSION_ENDED: Final = {Nrc.SERVICE_NOT_IN_SESSION, Nrc.SUB_FUNCTION_NOT_IN_SESSION, Nrc.SECURITY_ACCESS_DENIED}
STARTING_S: Final = 15.0
# OUT_OF_RANGE is the ECU's answer to a routine or a download whose session has ended.
_AGAIN: Final = (
    _SESSION_ENDED
    | {Nrc.SEQUENCE_ERROR, Nrc.UPLOAD_DOWNLOAD_NOT_ACCEPTED, Nrc.TRANSFER_SUSPENDED, Nrc.PROGRAMMING_FAILURE}
    | {Nrc.WRONG_BLOCK_COUNTER, Nrc.OUT_OF_RANGE, Nrc.CONDITIONS_NOT_CORRECT}
)
_DAMAGED_ON_THE_WAY: Final = {Verdict.INCOMPLETE, Verdict.WRONG_HASH, Verdict.UNREADABLE}


class Transfer:
    def __init__(self, asking: Asking, image: bytes, progress: OnProgress) -> None:
        self._asking, self._image, self._progress = asking, image, progress
        self._lengths = BlockLength()
        self._received = 0

    def run(self) -> tuple[int, int]:
        """Transfer the image, in several attempts if necessary. Afterwards the ECU's verdict is good, and the ECU is in
        the programming session and unlocked. Returns how many bytes the ECU had before, and the number of attempts.
        Raises ImageRefusedError for another verdict, LostError if the ECU no longer answers, and RefusedError,
        NotNowError or AccessError if it refuses a request."""
        resumed_from, attempts, stalls = 0, 0, 0
        while True:
            attempts, before = attempts + 1, self._received
            try:
                enter_programming(self._asking)
                offset = self._announce()
                resumed_from = offset if attempts == 1 else resumed_from
                self._received = offset
                self._progress(offset, len(self._image))
                verdict = self._bring(offset)
                if verdict is Verdict.GOOD:
                    return resumed_from, attempts
                failure: FlashError = messages.ImageRefusedError(verdict)
                if verdict not in _DAMAGED_ON_THE_WAY:
                    raise failure
            except RefusedError as refused:
                if refused.code not in _AGAIN:
                    raise
                failure = refused
            except NoAnswerError:
                failure = messages.LostError(self._received, len(self._image))
                try:
                    self._asking.wait_until_there(STARTING_S, "answer")
                except NoAnswerError:
                    raise failure from None
            stalls = 0 if self._received > before else stalls + 1
            if stalls >= STALLS:
                raise failure

    def _announce(self) -> int:
        option = len(self._image).to_bytes(4, "big") + hashlib.sha256(self._image).digest()
        answer = self._asking.routine(Routine.ERASE, option)
        offset = int.from_bytes(answer[:4], "big")
        if len(answer) != 4 or offset > len(self._image):
            raise RefusedError("state the byte from which it needs the image", Nrc.OUT_OF_RANGE)
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
            counter = (counter + 1) % 256
            offset += len(block)
            self._received = offset
            self._progress(offset, len(self._image))


def in_session(begin: Callable[[], None], step: Callable[[], object], *, has_begun: bool = False) -> None:
    """Begin a session, unless `has_begun`, and run a step in it. Repeat both if the session ended before the step."""
    for left in reversed(range(TRIES)):
        if not has_begun:
            begin()
        has_begun = False
        try:
            step()
            return
        except RefusedError as refused:
            if refused.code not in _SESSION_ENDED or not left:
                raise


def enter_programming(asking: Asking) -> None:
    in_session(lambda: asking.session(Session.PROGRAMMING), lambda: asking.unlock(Level.PROGRAMMING))


def in_programming(asking: Asking, routine: Routine) -> None:
    """Run a routine in the programming session; begin the session again if it has ended."""
    in_session(lambda: enter_programming(asking), lambda: asking.routine(routine), has_begun=True)


def bring(asking: Asking, raw: bytes, *, is_again: bool = False) -> tuple[int, int]:
    """Replace the key list; return the versions of the old list (0 if there was none) and of the new list. If
    `is_again`, a list of the ECU's present version is not sent: an earlier, interrupted call may have sent it. Raises
    WrongKeysError if the ECU rejects the new list; FlashError if the ECU may not write now or does not answer."""
    before = asking.number(Did.KEY_LIST, 4)
    if is_again and raw[key_list.VERSION] == before.to_bytes(4, "big"):
        return before, before
    enter_programming(asking)
    wrong = messages.WrongKeysError(
        f"the ECU refused the key list: it must be signed by the ECU's root key, have a version above {before}, and "
        "contain the key that signed the confirmed release"
    )
    with messages.refusal_means(Nrc.OUT_OF_RANGE, wrong):
        asking.write(Did.KEY_LIST, raw)
    after = asking.number(Did.KEY_LIST, 4)
    asking.session(Session.DEFAULT)
    return before, after
