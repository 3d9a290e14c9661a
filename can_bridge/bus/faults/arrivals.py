"""When frames arrived that a node finds at one look at its bus."""

from collections.abc import Iterable

from can_bridge.wire.frame import Frame


class Arrivals:
    """Tells when frames arrived: at their time stamp, if that lies between the node's last two looks at the bus, as it
    does where stamps and looks have one clock; otherwise at the look that found them. Never before the frame ahead.
    """

    def __init__(self) -> None:
        self._looked_ns = 0
        self._latest_ns = 0

    def of(self, frames: Iterable[Frame], now_ns: int) -> list[tuple[int, Frame]]:
        """The frames found now, each with the time of its arrival."""
        arrived: list[tuple[int, Frame]] = []
        for frame in frames:
            stamp_ns = frame.timestamp_ns
            # The bus returns the oldest first, whatever their stamps are.
            self._latest_ns = max(self._latest_ns, stamp_ns if self._looked_ns <= stamp_ns <= now_ns else now_ns)
            arrived.append((self._latest_ns, frame))
        self._looked_ns = now_ns
        return arrived
