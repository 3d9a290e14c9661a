"""The texts for viewers about changes of ECU, vehicle and bus between two periods, and a log of events."""

from collections.abc import Iterator, Mapping
from typing import Final, NamedTuple

from can_bridge.bus.interface import BusState
from can_bridge.command_gate import Intervention
from can_bridge.wire.messages import Reason
from ecu.fail_safe import OperatingMode
from firmware_sim.live.loop.messages import LiveMessage
from firmware_sim.runs.reasons import BECAUSE, DOES

UNPOWERED: Final = "UNPOWERED"
BOOT: Final = "BOOT"
"""States in addition to the names of `OperatingMode`: the ECU boots (BOOT) or has no supply (UNPOWERED)."""
_DOES: Final[Mapping[str, str]] = {
    UNPOWERED: "no supply: the ECU is silent",
    BOOT: "the ECU starts, and receives nothing meanwhile",
    "INIT": "on, waiting for pressures",
    "STANDBY": "pressures arrive, the jets stay shut",
    "ARMED": "ready, control is not requested",
    "UPDATE": "the jets are shut",
    **DOES,
}
_GATE: Final[Mapping[Intervention, str]] = {
    Intervention.NOT_FINITE: "the command was not a number: the jets are shut",
    Intervention.CLOCK: "the clock stood still: the jets are shut",
    Intervention.STALE: "the pressures of the command are too old: the jets are shut",
    Intervention.RANGE: "the command is limited to the jets' range",
    Intervention.RATE: "the command is limited to the largest step from the last command",
}
_NODE: Final[Mapping[BusState, str]] = {
    BusState.ERROR_ACTIVE: "free of errors again (error-active)",
    BusState.ERROR_PASSIVE: "error-passive: it counts many errors, and may no longer stop others' frames",
    BusState.BUS_OFF: "bus-off: it takes no part until it has recovered",
}
KEPT: Final = 500
"""Largest number of events stored until they are fetched."""
QUIET_S: Final = 1.0
"""Time in s after an event in which repetitions are counted. An event then states the count, and the time doubles."""
_LONGEST_S: Final = 16.0


class SeenState(NamedTuple):
    """The state after a period: the name of an `OperatingMode`, or `UNPOWERED` or `BOOT`; the sensors that the ECU has
    set aside; whether the vehicle has withdrawn its request without a viewer's command; the nodes' CAN controllers."""

    state: str
    reason: Reason
    set_aside: tuple[str, ...]
    given_up: bool
    gate: Intervention
    nodes: Mapping[str, BusState]


FIRST_SEEN: Final = SeenState(OperatingMode.INIT.name, Reason.NONE, (), False, Intervention(0), {})


def noticed(before: SeenState, now: SeenState) -> Iterator[tuple[str, str]]:
    """Yield (kind, text) for each change."""
    if now.state != before.state:
        because = f"{BECAUSE[now.reason]}; " if BECAUSE[now.reason] else ""
        yield "state", f"{before.state} to {now.state}: {because}{_DOES[now.state]}"
    elif now.reason not in (before.reason, Reason.NONE):
        yield "state", f"{now.state}: {BECAUSE[now.reason]}"
    for name in now.set_aside:
        if name not in before.set_aside:
            yield "state", f"{name} is set aside: it contradicts the others, and is estimated from them"
    for name in before.set_aside:
        if name not in now.set_aside:
            yield "state", f"{name} is used again: the ECU has started again"
    if now.given_up != before.given_up:
        ended = "the vehicle ends control and shuts its jets: too many commands were missing"
        yield "vehicle", ended if now.given_up else "the vehicle may request control again"
    for bit, text in _GATE.items():
        if bit in now.gate and bit not in before.gate:
            yield "state", text
    for node, state in now.nodes.items():
        if state is not before.nodes.get(node, BusState.ERROR_ACTIVE):
            yield "bus", f"{node}: CAN controller {_NODE[state]}"


class _Repeated(NamedTuple):
    kind: str
    since_s: float
    quiet_s: float
    more: int = 0


class EventLog:
    """The events of a session, numbered consecutively over all runs of the loop."""

    def __init__(self) -> None:
        self._new: list[LiveMessage] = []
        self._repeated: dict[str, _Repeated] = {}
        self._count = 0

    def add(self, kind: str, text: str, *, time_s: float, t: float) -> None:
        """Add an event at a time of the run, given in s (`time_s`) and in t_c (`t`)."""
        if kind != "set":
            if repeated := self._repeated.get(text):
                self._repeated[text] = repeated._replace(more=repeated.more + 1)
                return
            self._repeated[text] = _Repeated(kind, time_s, QUIET_S)
        self._publish(kind, text, time_s, t)

    def pass_to(self, time_s: float, t: float) -> None:
        """Advance the time. For each repeated event whose counting time is over, add an event with the count."""
        for text, repeated in list(self._repeated.items()):
            if time_s - repeated.since_s < repeated.quiet_s:
                continue
            del self._repeated[text]
            if repeated.more:
                times = "once" if repeated.more == 1 else f"{repeated.more} times"
                self._publish(repeated.kind, f"{text} (again {times} in {repeated.quiet_s:g} s)", time_s, t)
                self._repeated[text] = _Repeated(repeated.kind, time_s, min(2.0 * repeated.quiet_s, _LONGEST_S))

    def new_run(self) -> None:
        """Delete the counts of repeated events, because the time starts again at 0."""
        self._repeated = {}

    def new(self) -> list[LiveMessage]:
        """Return the events added since the last call, at most the newest `KEPT` events."""
        items, self._new = self._new, []
        return items

    def _publish(self, kind: str, text: str, time_s: float, t: float) -> None:
        item = {"n": self._count, "time_s": time_s, "t": t, "kind": kind, "text": text}
        self._count += 1
        self._new = [*self._new, item][-KEPT:]
