"""What happened, for people: the latest events. What happens again and again is said ever more seldom, but for what
viewers have set.
"""

from collections import deque
from typing import Final, NamedTuple

from firmware_sim.live.loop.messages import EventItem

KEPT: Final = 500
"""Latest events."""
QUIET_S: Final = 1.0
"""Virtual time for which the same is not said again; then it is said how often it was, and for twice as long not."""
LONGEST_S: Final = 16.0


class _Said(NamedTuple):
    kind: str
    since_s: float
    quiet_s: float
    more: int = 0


class EventLog:
    """Events of a session; their numbers go on from one run of the loop to the next.

    Attributes:
        kept: the latest.
    """

    def __init__(self) -> None:
        self.kept: deque[EventItem] = deque(maxlen=KEPT)
        self._new: list[EventItem] = []
        self._said: dict[str, _Said] = {}
        self._count = 0

    def add(self, kind: str, text: str, *, time_s: float, t: float) -> None:
        """Something happened now, in s and t_c of the run."""
        if kind != "set":
            if said := self._said.get(text):
                self._said[text] = said._replace(more=said.more + 1)
                return
            self._said[text] = _Said(kind, time_s, QUIET_S)
        self._tell(kind, text, time_s, t)

    def pass_to(self, time_s: float, t: float) -> None:
        """Time has passed: what came again and again is told."""
        for text, said in list(self._said.items()):
            if time_s - said.since_s < said.quiet_s:
                continue
            del self._said[text]
            if said.more:
                times = "once" if said.more == 1 else f"{said.more} times"
                self._tell(said.kind, f"{text} (again {times} in {said.quiet_s:g} s)", time_s, t)
                self._said[text] = _Said(said.kind, time_s, min(2.0 * said.quiet_s, LONGEST_S))

    def new_run(self) -> None:
        """Time begins anew."""
        self._said = {}

    def new(self) -> list[EventItem]:
        """Those since this was asked last, the latest `KEPT` of them."""
        items, self._new = self._new, []
        return items

    def _tell(self, kind: str, text: str, time_s: float, t: float) -> None:
        item: EventItem = {"n": self._count, "time_s": time_s, "t": t, "kind": kind, "text": text}
        self._count += 1
        self.kept.append(item)
        self._new = [*self._new, item][-KEPT:]
