"""A CAN bus in virtual time: arbitration, exact frame lengths, errors and fault confinement, without a clock or thread.

Every node has a port with a queue (`can_bridge.bus.simulated.port`) and a controller's error counters
(`can_bridge.bus.simulated.attempt`). docs/explanation/simulated-bus.md describes the model and its limits.

Time passes only in `advance_to` and `advance_until`, and jumps from event to event. A frame that begins at the present
time waits until time passes, because other nodes can still send at that instant and take part in the arbitration.
"""

import heapq
from collections.abc import Callable
from dataclasses import replace
from operator import itemgetter
from typing import Final, NamedTuple

from can_bridge.bus.simulated.attempt import AttemptOutcome, AttemptVerdict, counted, resolve
from can_bridge.bus.simulated.port import RECESSIVE_BITS, Queued, Recovery, SimulatedPort
from can_bridge.wire.frame import Frame
from can_bridge.wire.frame_bits import bits_ns, frame_ns
from contract.config.vehicle import BusConfig

Corrupts = Callable[[Frame, str, int], int | None]
"""A function that takes a frame, the name of its sender or receiver, and the time in ns at which the frame starts. It
returns the index of the inverted bit; None if no bit is inverted."""

SUSPEND: Final = 8
"""Number of bits for which an error-passive node waits between two frames of its own. If another node begins a frame
during the wait, the waiting node may send right after that frame, because the frame outlasts the wait."""


class Transmission(NamedTuple):
    """A frame that was sent, stamped with `end_ns`; the attempt took `begin_ns` to `end_ns` without intermission."""

    frame: Frame
    sender: str
    queued_ns: int
    begin_ns: int
    end_ns: int


class BusActivity(NamedTuple):
    """The activity until `now_ns`: numbers of sent frames and destroyed attempts, and their time on the bus."""

    frames: int
    error_frames: int
    busy_ns: int
    now_ns: int

    @property
    def load(self) -> float:
        """The share of time in which the bus was occupied, 0 to 1."""
        return min(self.busy_ns / self.now_ns, 1.0) if self.now_ns else 0.0


class _Attempt(NamedTuple):
    """The attempt that is on the bus. The outcome takes effect at `end_ns`, and the next frame can begin at `free_ns`;
    `items` has the entries of the frame in the senders' queues."""

    begin_ns: int
    end_ns: int
    free_ns: int
    outcome: AttemptOutcome
    items: dict[SimulatedPort, Queued]


class SimulatedBus:
    """A bus that connects ports. Its virtual time begins at 0.

    Args:
        capture: called with every frame sent over the bus, stamped with the end of frame, in the order of time.
        observe: called with a `Transmission` for each frame sent over the bus.
        corrupts: returns the bit that is wrong for all nodes; called once for each attempt, with the sender's name. A
            position after the frame means its last bit, which receivers do not check: they get the frame twice.
        mishears: returns the bit that only one receiver sees wrong; called once for each attempt and each receiver,
            with the receiver's name.
    """

    def __init__(
        self,
        config: BusConfig,
        capture: Callable[[Frame], None] = lambda frame: None,
        *,
        observe: Callable[[Transmission], None] = lambda transmission: None,
        corrupts: Corrupts | None = None,
        mishears: Corrupts | None = None,
    ) -> None:
        self._rates = {"nominal_bitrate": config.nominal_bitrate, "data_bitrate": config.data_bitrate}
        self._capture, self._observe = capture, observe
        self._corrupts, self._mishears = corrupts, mishears
        self._ports: list[SimulatedPort] = []
        self._attempt: _Attempt | None = None
        self._free_ns = 0
        self._calls: list[tuple[int, int, Callable[[], None]]] = []
        self._serial = 0
        self._frames = self._error_frames = self._busy_ns = 0
        self.now_ns = 0

    def port(self, name: str = "") -> SimulatedPort:
        """Connect one more node, and return its port. Error messages, `corrupts` and `mishears` get the node's name."""
        port = SimulatedPort(name or f"node {len(self._ports)}", lambda: self.now_ns)
        self._ports.append(port)
        return port

    def frame_ns(self, frame: Frame) -> int:
        """Return the time in ns for which this frame occupies the bus, including the intermission."""
        return frame_ns(frame, **self._rates)

    def under_way(self, frame_id: int) -> int:
        """Return the number of frames with this 11-bit identifier that wait for the bus or are on the bus."""
        frames = (item.frame for port in self._ports for item in port.waiting)
        return sum(frame.frame_id == frame_id and not frame.is_extended for frame in frames)

    def activity(self) -> BusActivity:
        """Return the activity so far, without the attempt that is on the bus now."""
        return BusActivity(self._frames, self._error_frames, self._busy_ns, self.now_ns)

    def call_at(self, at_ns: int, action: Callable[[], None]) -> None:
        """Run `action` at `at_ns`, after frames that arrive then, before the arbitration. Raises ValueError if past."""
        if at_ns < self.now_ns:
            raise ValueError(f"cannot call at {at_ns} ns: the bus is at {self.now_ns} ns already")
        self._serial += 1
        heapq.heappush(self._calls, (at_ns, self._serial, action))

    def advance_to(self, t_ns: int) -> None:
        """Advance to `t_ns`, with all events up to it except frames that begin at it. Raises ValueError if past."""
        self.advance_until(t_ns, lambda: False)

    def advance_until(self, t_ns: int, stop: Callable[[], bool]) -> bool:
        """Do as `advance_to`, but stop at the first event after which `stop()` is true; return whether it was true."""
        if t_ns < self.now_ns:
            raise ValueError(f"cannot advance to {t_ns} ns: the bus is at {self.now_ns} ns already")
        while (due := self._next_event()) is not None and due[0] <= t_ns:
            at_ns, happen = due
            if happen is None and at_ns == t_ns:
                break
            self.now_ns = at_ns
            if happen is None:
                self._begin(at_ns)
                continue
            happen()
            if stop():
                return True
        self.now_ns = t_ns
        return False

    def _next_event(self) -> tuple[int, Callable[[], None] | None] | None:
        """Return time and action of the earliest event; the action is None for a frame that begins. Simultaneous events
        have this order: a frame ends, a node recovers, an action of `call_at` runs, a frame begins."""
        events: list[tuple[int, Callable[[], None] | None]] = []
        if self._attempt is not None:
            events.append((self._attempt.end_ns, self._end))
        else:
            for port in self._ports:
                if port.recovery is not None:
                    idle_ns = self._ns(RECESSIVE_BITS * max(port.recovery.left, 0))
                    events.append((max(self._free_ns, port.recovery.since_ns) + idle_ns, port.recover))
        if self._calls:
            events.append((self._calls[0][0], lambda: heapq.heappop(self._calls)[2]()))
        if self._attempt is None:
            events += [(max(self._free_ns, port.ready_ns), None) for port in self._ports if port.waiting]
        return min(events, key=itemgetter(0), default=None)

    def _begin(self, at_ns: int) -> None:
        heads = {port: port.waiting[0] for port in self._ports if port.waiting and port.ready_ns <= at_ns}
        wins = min(item.priority for item in heads.values())
        items = {port: item for port, item in heads.items() if item.priority == wins}
        for port in self._ports:
            if port.recovery is not None:
                idle_ns = max(at_ns - max(self._free_ns, port.recovery.since_ns), 0)
                port.recovery = Recovery(port.recovery.left - idle_ns // self._ns(RECESSIVE_BITS), at_ns)
        frames = {port: item.frame for port, item in items.items()}
        receivers = [port for port in self._ports if not port.is_off and port not in items]
        first, frame = next(iter(frames.items()))
        misheard = _seen_wrong(self._mishears, frame, receivers, at_ns)
        disturbed = _seen_wrong(self._corrupts, frame, [first], at_ns).get(first)
        outcome = resolve(frames, receivers, misheard=misheard, disturbed=disturbed)
        nominal, fast = outcome.used
        end_ns, free_ns = at_ns + self._ns(nominal, fast), at_ns + self._ns(nominal + outcome.rest, fast)
        self._attempt = _Attempt(at_ns, end_ns, free_ns, outcome, items)

    def _end(self) -> None:
        assert self._attempt is not None
        attempt, self._attempt = self._attempt, None
        self._free_ns = attempt.free_ns
        self._busy_ns += attempt.free_ns - attempt.begin_ns
        frame = replace(attempt.outcome.frame, timestamp_ns=attempt.end_ns)
        for port, verdict in attempt.outcome.verdicts.items():
            port.errors = counted(port.errors, verdict)
            if verdict.is_senders and port.is_passive:
                port.ready_ns = attempt.free_ns + self._ns(SUSPEND)
            if verdict is AttemptVerdict.HEARD:
                port.deliver(frame)
        sent = [port for port, verdict in attempt.outcome.verdicts.items() if verdict is AttemptVerdict.SENT]
        for port in sent:
            port.sent(attempt.items[port])
        if sent:
            # If several nodes sent an identical frame at the same time, the bus carried only one frame.
            self._frames += 1
            self._capture(frame)
        else:
            self._error_frames += 1
        for port in sent:
            queued_ns = attempt.items[port].queued_ns
            self._observe(Transmission(frame, port.name, queued_ns, attempt.begin_ns, attempt.end_ns))
        for port in self._ports:
            port.settle(attempt.end_ns)
            if port.recovery is not None:
                # Every frame and error frame ends with one of the recessive sequences that a recovering node counts.
                port.recovery = Recovery(port.recovery.left - 1, attempt.free_ns)

    def _ns(self, nominal: int, fast: int = 0) -> int:
        return bits_ns(nominal, fast, **self._rates)


def _seen_wrong(ask: Corrupts | None, frame: Frame, ports: list[SimulatedPort], t_ns: int) -> dict[SimulatedPort, int]:
    answers = {} if ask is None else {port: ask(frame, port.name, t_ns) for port in ports}
    return {port: position for port, position in answers.items() if position is not None}
