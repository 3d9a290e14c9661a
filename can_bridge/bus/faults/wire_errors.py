"""Bits that are wrong on the wire itself, for the hooks of the simulated bus.

CAN finds these errors and sends the frame again: they cost time and raise the error counters up to bus-off, and hardly
ever reach a receiver. What CAN cannot find is `content.py`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import log1p
from random import Random
from typing import Final

from can_bridge.bus.faults.fault import Probability, Span
from can_bridge.wire.frame import Frame
from can_bridge.wire.frame_bits import frame_bits

_INTERMISSION: Final = 3


@dataclass(frozen=True, kw_only=True)
class WireErrors(Span, section="wire_errors"):
    """Each bit is wrong with the same probability, independent of the others; the first one in a frame counts."""

    bit_error_rate: Probability[float]
    """CAN FD's bits are shorter at the data rate and as likely to be wrong as the others."""
    nodes: tuple[str, ...] = ()
    """Names of the ports at which the bits are wrong; empty for all. `corrupts` asks with the sender's and is heard by
    all nodes, `mishears` with a receiver's and is seen by this one alone."""
    frame_ids: tuple[int, ...] = ()
    """Identifiers of the frames that it concerns; empty for all."""

    def hook(self, seed: int) -> Callable[[Frame, str, int], int | None]:
        """For `corrupts` or `mishears` of a `can_bridge.bus.simulated.SimulatedBus`; each needs one of its own."""
        random = Random(f"{seed} {self.section}")
        rate = self.bit_error_rate

        def first_wrong_bit(frame: Frame, node: str, begin_ns: int) -> int | None:
            if (self.nodes and node not in self.nodes) or (self.frame_ids and frame.frame_id not in self.frame_ids):
                return None
            if rate == 0.0 or not self.is_active(begin_ns):
                return None
            # The place of the first success among independent trials is geometric; by inversion of a uniform draw.
            draw = random.random()
            place = 0 if rate == 1.0 else int(log1p(-draw) / log1p(-rate))
            return place if place < sum(frame_bits(frame)) - _INTERMISSION else None

        return first_wrong_bit
