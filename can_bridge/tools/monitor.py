"""What a live view of a bus shows, apart from any terminal: the messages seen so far, with their signals as text."""

from typing import Final

from can_bridge.tools.observed_traffic import Traffic
from can_bridge.tools.raw_bus import id_text
from can_bridge.tools.signals import PROTECTION
from can_bridge.tools.summary import Summary

MOST_MESSAGES: Final = 1000
"""That are listed: more than a vehicle's bus has, and a bound where someone sends random identifiers of 29 bits."""

Cell = tuple[str, str, str]
"""A signal, its value and its unit."""


def rows(summary: Summary, *, matching: str = "") -> list[tuple[Traffic, list[Cell]]]:
    """The messages with their signals, ordered by identifier; of one that is not known, or not readable, its bytes.

    Args:
        matching: words that message, identifier or signal must contain, all of them; case does not count.
    """
    words = matching.lower().split()
    shown = []
    for _, traffic in sorted(summary.messages.items()):
        head = f"{traffic.name or 'unknown'} {id_text(traffic.latest)}"
        cells = [one for one in _cells(traffic) if all(word in f"{head} {one[0]}".lower() for word in words)]
        if cells:
            shown.append((traffic, cells))
    return shown


def _cells(traffic: Traffic) -> list[Cell]:
    signals = () if traffic.decoded is None else traffic.decoded.signals
    cells = [(one.name, one.shown, one.unit) for one in signals if one.name not in PROTECTION]
    what = "data" if traffic.decoded is None else "not readable"
    return cells or [(what, traffic.latest.data.hex(" ") or "empty", "")]
