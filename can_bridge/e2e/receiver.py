"""The receiving end of a protected message: is this frame new, and is the stream to be trusted?

Two layers, as in AUTOSAR (PRS_E2EProtocol, "E2E profile check" and "E2E state machine"): each frame gets a
`Check` from its CRC and counter, and a window of the latest checks drives the `StreamState`:

- NODATA until a frame passes its CRC, then INIT;
- INIT and INVALID become VALID with `min_ok` good checks and at most `max_errors` bad ones in the window;
- INIT becomes INVALID with more bad ones than that;
- VALID becomes INVALID with more bad ones than that, or with no good one left.

A repeated frame, a jump in the counter and a period without a frame are neither good nor bad: they push good
checks out of the window. As in the standard, a jump moves the receiver to the new count, so that a restarted sender
is followed from its second frame on.
"""

from collections import Counter, deque
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum, auto

from can_bridge.e2e import profile5 as e2e_profile5
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import MessageSpec
from contract.config.tree import E2eConfig


class Check(Enum):
    """What was found on one look at the stream."""

    OK = auto()
    OK_SOME_LOST = auto()
    REPEATED = auto()
    WRONG_SEQUENCE = auto()
    ERROR = auto()
    """Wrong CRC or length."""
    NO_NEW_DATA = auto()


class StreamState(Enum):
    """Whether the stream as a whole is to be trusted."""

    NODATA = auto()
    INIT = auto()
    VALID = auto()
    INVALID = auto()


GOOD = frozenset({Check.OK, Check.OK_SOME_LOST})


@dataclass(frozen=True, kw_only=True)
class Reception:
    """The outcome of one period.

    Attributes:
        state: after this period.
        checks: one for each frame of the message, oldest first; NO_NEW_DATA alone if there was none.
        accepted: the newest frame that was good by itself, whatever the state; None if there was none.
    """

    state: StreamState
    checks: tuple[Check, ...]
    accepted: Frame | None

    @property
    def live(self) -> Frame | None:
        """The accepted frame if the stream is VALID: the only thing that may refresh liveness."""
        return self.accepted if self.state is StreamState.VALID else None


class E2eReceiver:
    """Checks one message; `tick` it once a period with whatever arrived.

    Attributes:
        state: of the stream.
        last_counter: of the latest frame with a good CRC; None before the first.
        counts: how often each check came out since construction.
        window: the latest checks, oldest first.
    """

    def __init__(self, spec: MessageSpec, config: E2eConfig) -> None:
        self.spec = spec
        self.config = config
        self.state = StreamState.NODATA
        self.last_counter: int | None = None
        self.counts: Counter[Check] = Counter()
        self.window: deque[Check] = deque(maxlen=config.window)

    def tick(self, frames: Iterable[Frame]) -> Reception:
        """One period with all frames received in it, oldest first; those of other messages are left alone."""
        checks: list[Check] = []
        accepted: Frame | None = None
        for frame in frames:
            if frame.frame_id != self.spec.frame_id:
                continue
            check = self._check(frame.data)
            checks.append(check)
            if check in GOOD:
                accepted = frame
        for check in checks or [Check.NO_NEW_DATA]:
            self._advance(check)
        return Reception(state=self.state, checks=tuple(checks) or (Check.NO_NEW_DATA,), accepted=accepted)

    def _check(self, data: bytes) -> Check:
        if len(data) != self.spec.length or not e2e_profile5.check(data, data_id=self.spec.data_id):
            return Check.ERROR
        counter, last = e2e_profile5.counter_of(data), self.last_counter
        self.last_counter = counter
        # The first frame has nothing to be compared with.
        delta = 1 if last is None else (counter - last) % e2e_profile5.COUNTER_PERIOD
        if delta == 0:
            return Check.REPEATED
        if delta == 1:
            return Check.OK
        return Check.OK_SOME_LOST if delta <= self.config.max_delta else Check.WRONG_SEQUENCE

    def _advance(self, check: Check) -> None:
        self.counts[check] += 1
        self.window.append(check)
        good = sum(item in GOOD for item in self.window)
        too_many_errors = self.window.count(Check.ERROR) > self.config.max_errors
        if self.state is StreamState.NODATA:
            if check not in (Check.ERROR, Check.NO_NEW_DATA):
                self.state = StreamState.INIT
        elif self.state is StreamState.VALID:
            if too_many_errors or good == 0:
                self.state = StreamState.INVALID
        elif not too_many_errors and good >= self.config.min_ok:
            self.state = StreamState.VALID
        elif self.state is StreamState.INIT and too_many_errors:
            self.state = StreamState.INVALID
