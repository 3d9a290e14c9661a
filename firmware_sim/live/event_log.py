"""The latest events, for people. A repeated event is listed ever more seldom, except what viewers set."""

from typing import Final, NamedTuple

from firmware_sim.live.loop.messages import Message

KEPT: Final = 500
"""Latest events that wait to be asked for."""
QUIET_S: Final = 1.0
"""Virtual time without the same event; then one event has their number, and the time doubles."""
LONGEST_S: Final = 16.0


class _Repeated(NamedTuple):
    kind: str
    since_s: float
    quiet_s: float
    more: int = 0


class EventLog:
    """Events of a session; their numbers go on from one run of the loop to the next."""

    def __init__(self) -> None:
        self._new: list[Message] = []
        self._repeated: dict[str, _Repeated] = {}
        self._count = 0

    def add(self, kind: str, text: str, *, time_s: float, t: float) -> None:
        """Something happened now, in s and t_c of the run."""
        if kind != "set":
            if repeated := self._repeated.get(text):
                self._repeated[text] = repeated._replace(more=repeated.more + 1)
                return
            self._repeated[text] = _Repeated(kind, time_s, QUIET_S)
        self._publish(kind, text, time_s, t)

    def pass_to(self, time_s: float, t: float) -> None:
        """Time has passed: list what was repeated."""
        for text, repeated in list(self._repeated.items()):
            if time_s - repeated.since_s < repeated.quiet_s:
                continue
            del self._repeated[text]
            if repeated.more:
                times = "once" if repeated.more == 1 else f"{repeated.more} times"
                self._publish(repeated.kind, f"{text} (again {times} in {repeated.quiet_s:g} s)", time_s, t)
                self._repeated[text] = _Repeated(repeated.kind, time_s, min(2.0 * repeated.quiet_s, LONGEST_S))

    def new_run(self) -> None:
        """Time begins again at 0."""
        self._repeated = {}

    def new(self) -> list[Message]:
        """Those since this was asked last, the latest `KEPT` of them."""
        items, self._new = self._new, []
        return items

    def _publish(self, kind: str, text: str, time_s: float, t: float) -> None:
        item = {"n": self._count, "time_s": time_s, "t": t, "kind": kind, "text": text}
        self._count += 1
        self._new = [*self._new, item][-KEPT:]
