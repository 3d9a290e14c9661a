"""The errors of flashing. Each error has a one-line message and an exit status.

The status states the remedy. 3: repair the connection. 4: use the right key. 5: try again when the vehicle is
stationary. 6: use another release or key list. 7: examine the ECU. 8: the new release failed, and the previous release
runs. The status is 1 for all other errors, such as a key file that cannot be read, and 2 for wrong use of a command.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import ClassVar

from can_bridge.flashing.verdicts import Verdict
from can_bridge.uds.services import Nrc
from contract.errors import FlashError


class NoAnswerError(FlashError):
    """The ECU does not answer, or no longer answers."""

    status: ClassVar[int] = 3

    def __init__(self, step: str, *, was_there: bool = True) -> None:
        what = f"the ECU does not {step}" if was_there else "no ECU answers on this bus"
        super().__init__(
            f"{what}; check its power, that it runs with --slots, and that interface, channel, bus.frames and "
            "bus.diagnosis equal its settings"
        )


class LostError(NoAnswerError):
    """The connection was lost during a transfer; the transfer can be continued."""

    def __init__(self, received: int, length: int) -> None:
        FlashError.__init__(
            self,
            f"the ECU no longer answers; it has {received} of {length} bytes and still runs the previous release: the "
            "same command continues from there",
        )


class AccessError(FlashError):
    """The key is not the key of this ECU."""

    status: ClassVar[int] = 4


class NotNowError(FlashError):
    """The vehicle's state does not allow its ECU to be programmed."""

    status: ClassVar[int] = 5


class WrongReleaseError(FlashError):
    """The release is not for this ECU, or the ECU may not accept it."""

    status: ClassVar[int] = 6


class WrongKeysError(FlashError):
    """The ECU does not accept the key list."""

    status: ClassVar[int] = 6


class ImageRefusedError(WrongReleaseError):
    """The ECU rejected a transferred image; `verdict` is the reason."""

    def __init__(self, verdict: Verdict) -> None:
        super().__init__(f"the ECU refused the release: {verdict.in_words}; it keeps its present release")
        self.verdict = verdict


class NotPassedError(FlashError):
    """The new release failed its trial."""

    status: ClassVar[int] = 8


class RefusedError(FlashError):
    """The ECU sent a negative response, with `code`."""

    status: ClassVar[int] = 7

    def __init__(self, step: str, code: int) -> None:
        name = Nrc(code).name.lower().replace("_", " ") if code in Nrc.__members__.values() else "unknown code"
        super().__init__(f"the ECU refused to {step}: {name} (0x{code:02X})")
        self.code = code


@contextmanager
def refusal_means(code: Nrc, error: FlashError) -> Iterator[None]:
    """Raise `error` in place of a RefusedError with this code."""
    try:
        yield
    except RefusedError as refused:
        if refused.code != code:
            raise
        raise error from refused


@contextmanager
def in_good_state(step: str, why: str) -> Iterator[None]:
    """Raise NotNowError, with the reason `why`, if the ECU refuses the step because of the vehicle's state."""
    text = f"the ECU refused to {step} now: {why}; withdraw the enable request and try again"
    with refusal_means(Nrc.CONDITIONS_NOT_CORRECT, NotNowError(text)):
        yield
