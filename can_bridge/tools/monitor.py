"""What a live view of a bus shows, apart from any terminal: frames in, rows out."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final

from can_bridge.secoc.key import Key as MacKey
from can_bridge.tools.observed_traffic import Mac, Traffic, observe
from can_bridge.tools.raw_bus import id_text
from can_bridge.tools.signals import PROTECTION
from can_bridge.wire.frame import Frame
from contract.config.vehicle import E2eConfig

Key = tuple[bool, int]
"""Extended or not, identifier: the order of the rows."""

MOST_MESSAGES: Final = 1000
"""That are listed: more than a vehicle's bus has, and a bound where someone sends random identifiers of 29 bits."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """One signal of one message; the first row of a message also has what is the message's.

    Attributes:
        age_s: since its newest frame.
        rate_hz: of the message.
        lost: frames missing by their counters.
        refused: frames that a receiver would not have used.
        e2e: the verdict on the newest frame, empty without protection.
        is_good: whether they let a receiver use it.
    """

    message: str
    frame_id: str
    signal: str
    value: str
    unit: str
    is_first: bool
    age_s: float
    rate_hz: float
    count: int
    lost: int
    refused: int
    e2e: str
    is_good: bool


@dataclass(frozen=True, kw_only=True)
class MonitorState:
    """Everything seen so far.

    Attributes:
        key: of secured messages; without it their authentication is not checked.
        unlisted: frames of identifiers beyond the first MOST_MESSAGES.
        others: remote and error frames.
    """

    e2e: E2eConfig = field(default_factory=E2eConfig)
    key: MacKey | None = field(default=None, repr=False)
    messages: Mapping[Key, Traffic] = field(default_factory=dict)
    unlisted: int = 0
    others: int = 0
    frames: int = 0

    def seen(self, frame: Frame) -> "MonitorState":
        """The state after one more frame, stamped with the time it came."""
        key = (frame.is_extended, frame.frame_id)
        if key not in self.messages and len(self.messages) >= MOST_MESSAGES:
            return replace(self, unlisted=self.unlisted + 1, frames=self.frames + 1)
        traffic = observe(self.messages.get(key), frame, e2e=self.e2e, key=self.key)
        return replace(self, messages={**self.messages, key: traffic}, frames=self.frames + 1)

    def seen_other(self) -> "MonitorState":
        """The state after one more remote or error frame."""
        return replace(self, others=self.others + 1)

    @property
    def lost(self) -> int:
        """Frames of all messages missing by their counters."""
        return sum(one.lost for one in self.messages.values())

    @property
    def refused(self) -> int:
        """Frames of all messages that a receiver would not have used."""
        return sum(one.refused for one in self.messages.values())

    @property
    def has_unchecked_macs(self) -> bool:
        """Whether there are secured messages, and no key to check them with."""
        return any(one.mac is Mac.NOT_CHECKED for one in self.messages.values())


def rows(state: MonitorState, now_ns: int, *, matching: str = "") -> list[Row]:
    """The table, ordered by identifier.

    Args:
        now_ns: in the clock of the frames.
        matching: words that message, identifier or signal must contain, all of them; case does not count.
    """
    words = matching.lower().split()
    shown: list[Row] = []
    for _, traffic in sorted(state.messages.items()):
        kept = [one for one in _rows_of(traffic, now_ns) if _matches(one, words)]
        shown.extend(replace(one, is_first=i == 0) for i, one in enumerate(kept))
    return shown


def _matches(row: Row, words: list[str]) -> bool:
    text = f"{row.message} {row.frame_id} {row.signal}".lower()
    return all(word in text for word in words)


def _rows_of(traffic: Traffic, now_ns: int) -> list[Row]:
    decoded = traffic.decoded
    shown = () if decoded is None else tuple(one for one in decoded.signals if one.name not in PROTECTION)
    cells = [(one.name, one.shown, one.unit) for one in shown]
    if not cells:
        what = "data" if decoded is None else "not readable"
        cells = [(what, traffic.latest.data.hex(" ") or "empty", "")]
    return [
        Row(
            message=traffic.name or "unknown",
            frame_id=id_text(traffic.latest),
            signal=signal,
            value=value,
            unit=unit,
            is_first=False,
            age_s=traffic.age_ns(now_ns) / 1e9,
            rate_hz=traffic.rate_hz(now_ns),
            count=traffic.count,
            lost=traffic.lost,
            refused=traffic.refused,
            e2e=traffic.verdict,
            is_good=traffic.is_good,
        )
        for signal, value, unit in cells
    ]
