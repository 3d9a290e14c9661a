"""The sending part of an M_CAN: dedicated buffers, the FIFO, and the frame in transmission, in virtual time."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

from can_bridge.wire.frame import Frame, priority


class _OnWire(NamedTuple):
    element: int
    frame: Frame
    end_ns: int


class TransmitBuffers:
    """The Tx buffer elements of an M_CAN: first `dedicated` dedicated buffers, then a FIFO of `size` elements.

    Args:
        element: function that returns the frame in an element.
        duration_ns: function that returns the time in ns from the start of a frame until the next frame may start.

    Attributes:
        pending, transmitted: bits of the elements that wait to be sent, and of elements sent since their last request.
        put: number of the FIFO's next free element.
        is_on: whether the controller takes part in the bus; if False, it starts no frame.
        left: sent frames in order, stamped with the time of the request, each with the end of transmission in ns.
    """

    def __init__(self, element: Callable[[int], Frame], duration_ns: Callable[[Frame], int]) -> None:
        self._element, self._duration_ns = element, duration_ns
        self.dedicated = self.size = self.put = 0
        self.pending = self.transmitted = 0
        self.is_on = False
        self.left = list[tuple[Frame, int]]()
        self._asked = dict[int, Frame]()
        self._order = list[int]()
        self._wire: _OnWire | None = None
        self._free_ns = 0

    def configure(self, dedicated: int, size: int) -> None:
        self.dedicated, self.size, self.put = dedicated, size, dedicated

    @property
    def free(self) -> int:
        return self.size - (self.pending >> self.dedicated).bit_count()

    def ask(self, bits: int, now_ns: int) -> None:
        """Request the transmission of the elements in `bits` with their present contents."""
        self.progress(now_ns)
        for index in range(self.dedicated + self.size):
            if bits >> index & 1:
                self._asked[index] = replace(self._element(index), timestamp_ns=now_ns)
                if index >= self.dedicated:
                    self._order.append(index)
                    self.put = self.dedicated + (self.put - self.dedicated + 1) % self.size
        self.pending |= bits
        self.transmitted &= ~bits

    def cancel(self, bits: int, now_ns: int) -> None:
        """Cancel the requests for the elements in `bits`, except for an element in transmission."""
        self.progress(now_ns)
        if self._wire is not None:
            bits &= ~(1 << self._wire.element)
        self._drop(bits)

    def switch(self, now_ns: int, *, is_on: bool) -> None:
        """Connect or disconnect the controller. After a disconnection, a frame in transmission waits again."""
        self.progress(now_ns)
        if is_on and not self.is_on:
            self._free_ns = max(self._free_ns, now_ns)
        self.is_on = is_on
        if not is_on:
            self._wire = None

    def progress(self, now_ns: int) -> None:
        """Simulate the transmissions until `now_ns`."""
        while True:
            if self._wire is not None:
                index, frame, self._free_ns = self._wire
                if self._free_ns > now_ns:
                    return
                self.left.append((frame, self._free_ns))
                self.transmitted |= 1 << index
                self._wire = None
                self._drop(1 << index)
            waiting = [*(k for k in range(self.dedicated) if self.pending >> k & 1), *self._order[:1]]
            if not waiting or not self.is_on:
                return
            begin_ns = max(self._free_ns, min(self._asked[k].timestamp_ns for k in waiting))
            if begin_ns > now_ns:
                return
            there = (k for k in waiting if self._asked[k].timestamp_ns <= begin_ns)
            index = min(there, key=lambda k: priority(self._asked[k]))
            self._wire = _OnWire(index, self._asked[index], begin_ns + self._duration_ns(self._asked[index]))

    def _drop(self, bits: int) -> None:
        self.pending &= ~bits
        self._order = [index for index in self._order if self.pending >> index & 1]
