"""The receiver of a protected message: it decides whether a frame is new, and whether the stream is trusted.

The receiver has two layers, as in AUTOSAR (PRS_E2EProtocol, "E2E profile check" and "E2E state machine"). Each frame
gets a `FrameCheck` from its CRC and counter, and a window of the latest checks drives the `StreamState`:

- NODATA becomes INIT in the first period with a frame and without an error; the window then has only this check;
- INIT and INVALID become VALID with at least `min_ok` good checks and at most `max_errors` bad checks in the window;
- INIT becomes INVALID with more than `max_errors` bad checks;
- VALID becomes INVALID with more than `max_errors` bad checks, or without a good check.

AUTOSAR's own machine leaves the check that ends NODATA out of the window. Here this check counts: with `min_ok` = 2 the
second frame of a stream is trusted. AUTOSAR's machine does the same with MinOkStateInit = 1, MinOkStateValid = 1 and
MinOkStateInvalid = 2, as long as the window holds the first check.

A repeated frame, a jump in the counter and a period without a frame are neither good nor bad, but they push good checks
out of the window. As in the standard, the receiver continues from the new count after a jump, so that the frames of a
restarted sender are good from the second frame on.

As in the standard, the state machine advances once a period, whatever the number of frames. The check of a period is an
error if the check of any of its frames is an error. Otherwise it is good if the check of any frame is good.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum, auto
from typing import Final

from can_bridge.e2e.profiles import profile_of
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import MessageSpec
from contract.config.vehicle import E2eConfig


class FrameCheck(Enum):
    """The result of the check of a frame or of a period; the value is the index in `ReceiverState.counts`."""

    OK = 0
    OK_SOME_LOST = 1
    REPEATED = 2
    WRONG_SEQUENCE = 3
    ERROR = 4
    """The CRC or the length is wrong."""
    NO_NEW_DATA = 5


class StreamState(Enum):
    """The state of a stream of frames; only a VALID stream is trusted."""

    NODATA = auto()
    INIT = auto()
    VALID = auto()
    INVALID = auto()


GOOD: Final = (FrameCheck.OK, FrameCheck.OK_SOME_LOST)
_REJECTED: Final = (FrameCheck.REPEATED, FrameCheck.WRONG_SEQUENCE, FrameCheck.ERROR)
_BY_WEIGHT: Final = (FrameCheck.ERROR, *GOOD, FrameCheck.WRONG_SEQUENCE, FrameCheck.REPEATED, FrameCheck.NO_NEW_DATA)
"""The results in order of weight: the check of a period is the first of these results that any of its frames has."""


@dataclass(frozen=True, kw_only=True)
class Reception:
    """The outcome of one period. `checks` has a check for each frame of the message, oldest first, or only NO_NEW_DATA.
    `accepted` is the newest frame with a good check, in any state of the stream."""

    stream: StreamState
    checks: tuple[FrameCheck, ...]
    accepted: Frame | None

    @property
    def live(self) -> Frame | None:
        """The accepted frame if the stream is VALID. Only this frame may count as a sign that the sender is alive."""
        return self.accepted if self.stream is StreamState.VALID else None


@dataclass(frozen=True, kw_only=True)
class ReceiverState:
    """The receiver's state for one message.

    Attributes:
        last_counter: counter of the latest frame with a valid CRC; None before the first frame.
        window: checks of the latest periods, oldest first, from the check that ended NODATA on.
        counts: number of checks with each result, at the index `FrameCheck.value`; read the numbers with `count`.
    """

    stream: StreamState = StreamState.NODATA
    last_counter: int | None = None
    window: tuple[FrameCheck, ...] = ()
    counts: tuple[int, ...] = (0,) * len(FrameCheck)

    def count(self, check: FrameCheck) -> int:
        return self.counts[check.value]

    @property
    def frames_rejected(self) -> int:
        return sum(self.count(check) for check in _REJECTED)


def receive(
    state: ReceiverState, frames: Iterable[Frame], *, spec: MessageSpec, config: E2eConfig
) -> tuple[ReceiverState, Reception]:
    """Return the state after one period, and the period's outcome. `frames` has all frames received in the period,
    oldest first; frames of other messages are ignored. Only the protected part of a secured message is checked."""
    checks: list[FrameCheck] = []
    accepted: Frame | None = None
    last_counter = state.last_counter
    for frame in frames:
        if not spec.names(frame):
            continue
        check, last_counter = _checked(frame.data, last_counter, spec=spec, max_delta=config.max_delta)
        checks.append(check)
        if check in GOOD:
            accepted = frame
    verdicts = tuple(checks) or (FrameCheck.NO_NEW_DATA,)
    counts = list(state.counts)
    for check in verdicts:
        counts[check.value] += 1
    period = next(check for check in _BY_WEIGHT if check in verdicts)
    stream, window = _advanced(state, period, config)
    after = ReceiverState(stream=stream, last_counter=last_counter, window=window, counts=tuple(counts))
    return after, Reception(stream=stream, checks=verdicts, accepted=accepted)


class E2eReceiver:
    """A receiver of one message; call `tick` once a period with the received frames."""

    def __init__(self, spec: MessageSpec, config: E2eConfig) -> None:
        self.spec = spec
        self.config = config
        self.state = ReceiverState()

    def tick(self, frames: Iterable[Frame]) -> Reception:
        self.state, reception = receive(self.state, frames, spec=self.spec, config=self.config)
        return reception


def _checked(
    data: bytes, last_counter: int | None, *, spec: MessageSpec, max_delta: int
) -> tuple[FrameCheck, int | None]:
    """Return the result of a frame's check, and the counter with which the next frame is compared."""
    profile = profile_of(spec)
    if len(data) != spec.length or not profile.check(data[: spec.protected], data_id=spec.data_id):
        return FrameCheck.ERROR, last_counter
    counter = profile.counter_of(data)
    # The first frame's counter has no predecessor, so it counts as the expected counter.
    delta = 1 if last_counter is None else (counter - last_counter) % profile.counter_period
    if delta == 0:
        return FrameCheck.REPEATED, counter
    if delta == 1:
        return FrameCheck.OK, counter
    return FrameCheck.OK_SOME_LOST if delta <= max_delta else FrameCheck.WRONG_SEQUENCE, counter


def _advanced(
    state: ReceiverState, period: FrameCheck, config: E2eConfig
) -> tuple[StreamState, tuple[FrameCheck, ...]]:
    if state.stream is StreamState.NODATA:
        if period in (FrameCheck.ERROR, FrameCheck.NO_NEW_DATA):
            return StreamState.NODATA, ()
        return StreamState.INIT, (period,)
    window = (*state.window, period)[-config.window :]
    good = sum(map(window.count, GOOD))
    too_many_errors = window.count(FrameCheck.ERROR) > config.max_errors
    if state.stream is StreamState.VALID:
        return StreamState.INVALID if too_many_errors or good == 0 else StreamState.VALID, window
    if not too_many_errors and good >= config.min_ok:
        return StreamState.VALID, window
    return StreamState.INVALID if too_many_errors else state.stream, window
