"""A Bosch M_CAN with its message RAM (user's manual, revision 3.3), as far as the firmware uses it.

Modelled: CCCR (INIT, CCE, FDOE, BRSE), NBTP, DBTP, TDCR, TSCC and TSCV (external counter), ECR (TEC, REC, RP), PSR (EP,
EW, BO), IR (RF0N, RF0L, BO), IE, ILE, GFC, SIDFC, XIDFC and XIDAM with classic filters into FIFO 0,
RXF0C, RXF0S, RXF0A, RXESC, TXBC with dedicated buffers and a FIFO after them, TXFQS, TXESC, TXBRP, TXBAR, TXBCR and
TXBTO; elements of up to 64 bytes with XTD, FDF and BRS. An access to any other register is an error.

A frame takes the time of its bits, including stuff bits and intermission, at the rates of the timing registers. After
its end the next frame is sent: the frame with the lowest identifier among the dedicated buffers and the FIFO's oldest
element. No other node is on this bus. While the controller is bus-off, frames wait. The recovery time is not modelled
here, because the bus that supplies the error counters models it.
"""

import struct
from collections.abc import Callable
from dataclasses import replace
from typing import Final, NamedTuple

from can_bridge.bus.interface import HEALTHY, BusHealth, BusState
from can_bridge.wire.frame import CLASSIC_LENGTHS, FD_LENGTHS, Frame, priority
from can_bridge.wire.frame_bits import frame_ns
from contract.errors import McuError

MESSAGE_RAM: Final = 0xC00
_RAM_BYTES: Final = 10 * 1024
CLOCK_HZ: Final = 80_000_000
_CCCR, _ECR, _PSR, _TSCC, _TSCV, _IR = 0x18, 0x40, 0x44, 0x20, 0x24, 0x50
_BITS, _EXTERNAL = 1, 2
_RXF0S, _RXF0A, _TXFQS, _TXBRP, _TXBAR, _TXBCR, _TXBTO = 0xA4, 0xA8, 0xC4, 0xCC, 0xD0, 0xD4, 0xD8
_DBTP, _NBTP, _GFC, _SIDFC, _XIDFC, _XIDAM, _RXF0C, _TXBC = 0x0C, 0x1C, 0x80, 0x84, 0x88, 0x90, 0xA0, 0xC0
_PLAIN: Final = {_DBTP, _NBTP, _TSCC, 0x48, 0x54, 0x5C, _GFC, _SIDFC, _XIDFC, _XIDAM, _RXF0C, 0xBC, _TXBC, 0xC8}
_PROTECTED: Final = _PLAIN - {0x54, 0x5C}  # writable only while INIT and CCE are set; `_PLAIN` only store values
_INIT, _CCE, _BRSE = 1, 2, 0x200
_RF0N, _RF0L, _BO = 1, 8, 1 << 25
_XTD, _FDF, _BRS = 1 << 30, 1 << 21, 1 << 20
_ELEMENT_WORDS: Final = 18
_EVER_NS: Final = 1 << 63


class CanController:
    """The registers and message RAM of a CAN controller. `clock` returns the board's time in ns; `stamps` returns the
    external counter at a time in ns. After the firmware clears INIT, `init_reads_late` reads of CCCR still show INIT,
    because the change passes to another clock domain. After a bus-off, `init_sets_late` reads do not show INIT yet."""

    def __init__(self, clock: Callable[[], int], stamps: Callable[[int], int]) -> None:
        self._clock, self._stamps = clock, stamps
        self._ram = bytearray(_RAM_BYTES)
        self._kept = dict.fromkeys(_PLAIN, 0) | {_XIDAM: 0x1FFF_FFFF}
        self._control, self._interrupts = _INIT, 0
        self._level = self._get = 0
        self._sending = TransmitBuffers(self._element, self._duration_ns)
        self._health, self._went_off = HEALTHY, 0
        self.init_reads_late = self._late = self.init_sets_late = self._early = 0

    @property
    def bit_rates(self) -> tuple[float, float]:
        """Nominal and data bit rate in bits per second, from the timing registers."""
        nominal, data = self._kept[_NBTP], self._kept[_DBTP]
        quanta = (nominal & 127) + (nominal >> 8 & 255) + 3, (data >> 4 & 15) + (data >> 8 & 31) + 3
        divider = (nominal >> 16 & 511) + 1, (data >> 16 & 31) + 1
        return CLOCK_HZ / quanta[0] / divider[0], CLOCK_HZ / quanta[1] / divider[1]

    @property
    def room(self) -> int:
        """Number of frames that FIFO 0 can still store."""
        return min(self._kept[_RXF0C] >> 16 & 127, 64) - self._level

    def surround(self, health: BusHealth) -> None:
        """Set the error counters to the values that the bus reports; every new bus-off sets INIT."""
        new, self._health = max(health.bus_off - self._health.bus_off, 0), health
        self._went_off, self._early = self._went_off + new, self.init_sets_late if new else self._early
        (self._go_off if new else self._switch)()

    def receive(self, frame: Frame) -> None:
        """Receive a frame from the bus. Drop the frame if no filter accepts it or FIFO 0 is full."""
        # If INIT was set by a bus-off, no check is needed here: the bus delivers no frames until the recovery.
        if (self._control & _INIT and not self._went_off) or not self._accepts(frame):
            return
        self._interrupts |= _RF0N
        if self.room <= 0:
            self._interrupts |= _RF0L
            return
        size = self._kept[_RXF0C] >> 16 & 127
        at = (self._kept[_RXF0C] & 0xFFFC) + (self._get + self._level) % size * 4 * _ELEMENT_WORDS
        lengths = FD_LENGTHS if frame.is_fd else CLASSIC_LENGTHS
        first = _XTD | frame.frame_id if frame.is_extended else frame.frame_id << 18
        second = lengths.index(len(frame.data)) << 16 | (_FDF | _BRS if frame.is_fd else 0)
        second |= self._time_stamp(frame.timestamp_ns)
        element = struct.pack("<II", first, second) + frame.data
        self._ram[at : at + len(element)] = element
        self._level += 1

    def taken(self, until_ns: int) -> list[Frame]:
        """Return the frames sent since the last call, until `until_ns`; a time stamp is the end of its frame."""
        return [replace(frame, timestamp_ns=end_ns) for frame, end_ns in self._sending.taken(until_ns)]

    def handed_over(self) -> list[Frame]:
        """Return all waiting frames, stamped with the times of their requests, for a bus that is modelled elsewhere."""
        return [frame for frame, _ in self._sending.taken(_EVER_NS)]

    def read(self, offset: int) -> int:
        """Read a register or a word of the message RAM; raises McuError for a register that is not modelled."""
        if offset >= MESSAGE_RAM:
            return int.from_bytes(self._ram[offset - MESSAGE_RAM : offset - MESSAGE_RAM + 4], "little")
        health, sending = self._health, self._sending
        sending.progress(self._clock())
        passive = max(health.tx_errors, health.rx_errors)
        size = self._kept[_RXF0C] >> 16 & 127
        put = (self._get + self._level) % size if size else 0
        known = self._kept | {
            _CCCR: self._control & ~_INIT if self._early else self._control | (_INIT if self._late else 0),
            _TSCV: self._time_stamp(self._clock()),
            _ECR: min(health.tx_errors, 255) | min(health.rx_errors, 127) << 8 | (health.rx_errors > 127) << 15,
            _PSR: self._is_off << 7 | (passive > 95) << 6 | (passive > 127) << 5,
            _IR: self._interrupts,
            _RXF0S: put << 16 | self._get << 8 | self._level,
            _TXFQS: sending.put << 16 | sending.free,
            _TXBRP: sending.pending,
            _TXBTO: sending.transmitted,
        }
        if offset not in known:
            raise McuError(f"CAN controller: no register to read at {offset:#x}")
        if offset == _CCCR:
            self._late, self._early = max(self._late - 1, 0), max(self._early - 1, 0)
        return known[offset]

    def write(self, offset: int, value: int) -> None:
        """Write a register or a word of the message RAM; raises McuError for an unmodelled or protected register."""
        if offset >= MESSAGE_RAM:
            self._ram[offset - MESSAGE_RAM : offset - MESSAGE_RAM + 4] = value.to_bytes(4, "little")
        elif offset == _CCCR:
            begins = self._control & _INIT and not value & _INIT
            self._control = value & ~_CCE if not value & _INIT else value
            if begins:
                self._late = self.init_reads_late
                self._went_off = max(self._went_off - 1, 0)
            self._go_off()
        elif offset in _PLAIN:
            if offset in _PROTECTED and self._control & (_INIT | _CCE) != _INIT | _CCE:
                raise McuError(f"CAN controller: register {offset:#x} is written without INIT and CCE")
            self._kept[offset] = value
            if offset == _TXBC:
                self._sending.configure(value >> 16 & 63, value >> 24 & 63)
        elif offset == _IR:
            self._interrupts &= ~value
        elif offset == _RXF0A:
            if self._level == 0 or value != self._get:
                raise McuError(f"CAN controller: element {value} of FIFO 0 is acknowledged before element {self._get}")
            self._get = (self._get + 1) % (self._kept[_RXF0C] >> 16 & 127)
            self._level -= 1
        elif offset == _TXBAR:
            self._sending.ask(value, self._clock())
        elif offset == _TXBCR:
            self._sending.cancel(value, self._clock())
        else:
            raise McuError(f"CAN controller: no register to write at {offset:#x}")

    @property
    def _is_off(self) -> bool:
        return self._went_off > 0 or self._health.state is BusState.BUS_OFF

    def _go_off(self) -> None:
        """Set INIT if the controller has gone bus-off. The hardware sets INIT once per bus-off, before the recovery."""
        if self._went_off:
            self._control |= _INIT
            self._interrupts |= _BO
        self._switch()

    def _switch(self) -> None:
        self._sending.switch(self._clock(), is_on=not (self._control & _INIT or self._is_off))

    def _duration_ns(self, frame: Frame) -> int:
        nominal, data = self.bit_rates
        return frame_ns(frame, nominal_bitrate=round(nominal), data_bitrate=round(data))

    def _element(self, index: int) -> Frame:
        at = (self._kept[_TXBC] & 0xFFFC) + index * 4 * _ELEMENT_WORDS
        first, second = struct.unpack_from("<II", self._ram, at)
        is_fd, code = bool(second & _FDF), second >> 16 & 15
        length = FD_LENGTHS[code] if is_fd else min(code, 8)
        return Frame(
            frame_id=first & 0x1FFF_FFFF if first & _XTD else first >> 18 & 0x7FF,
            data=bytes(self._ram[at + 8 : at + 8 + length]),
            is_fd=is_fd,
            is_extended=bool(first & _XTD),
        )

    def _accepts(self, frame: Frame) -> bool:
        if frame.is_extended:
            start, count = self._kept[_XIDFC] & 0xFFFC, self._kept[_XIDFC] >> 16 & 127
            for first, second in struct.iter_unpack("<II", self._ram[start : start + 8 * count]):
                if (frame.frame_id & self._kept[_XIDAM] ^ first) & second & 0x1FFF_FFFF == 0:
                    return bool(first >> 29 == 1)
            return not self._kept[_GFC] >> 2 & 2
        start, count = self._kept[_SIDFC] & 0xFFFC, self._kept[_SIDFC] >> 16 & 255
        for (element,) in struct.iter_unpack("<I", self._ram[start : start + 4 * count]):
            if (frame.frame_id ^ element >> 16) & element & 0x7FF == 0:
                return bool(element >> 27 & 7 == 1)
        return not self._kept[_GFC] >> 4 & 2

    def _time_stamp(self, at_ns: int) -> int:
        source = self._kept[_TSCC] & 3
        if source == _BITS and self._control & _BRSE:
            raise McuError("CAN controller: TSCC counts bits, but bit-rate switching makes bits of two durations")
        return self._stamps(at_ns) & 0xFFFF if source == _EXTERNAL else 0


class _OnWire(NamedTuple):
    element: int
    frame: Frame
    end_ns: int


class TransmitBuffers:
    """The Tx buffer elements of an M_CAN: first `dedicated` dedicated buffers, then a FIFO of `size` elements.
    `element` returns the frame in an element, `duration_ns` the time in ns from its start until the next may start.
    `pending` and `transmitted` have the bits of elements that wait to be sent, and that were sent since their last
    request. `put` is the FIFO's next free element. No frame is started unless `is_on`."""

    def __init__(self, element: Callable[[int], Frame], duration_ns: Callable[[Frame], int]) -> None:
        self._element, self._duration_ns = element, duration_ns
        self.dedicated = self.size = self.put = 0
        self.pending = self.transmitted = 0
        self.is_on = False
        self._left = list[tuple[Frame, int]]()
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
        """Connect or disconnect the controller. A frame in transmission is then stopped, and waits to be sent again."""
        self.progress(now_ns)
        if is_on and not self.is_on:
            self._free_ns = max(self._free_ns, now_ns)
        self.is_on = is_on
        if not is_on:
            self._wire = None

    def taken(self, until_ns: int) -> list[tuple[Frame, int]]:
        """Return the frames sent since the last call, stamped with their requests, and the ends of transmission in ns.
        Transmissions are simulated until `until_ns`."""
        self.progress(until_ns)
        left, self._left = self._left, []
        return left

    def progress(self, now_ns: int) -> None:
        """Simulate the transmissions until `now_ns`."""
        while True:
            if self._wire is not None:
                index, frame, self._free_ns = self._wire
                if self._free_ns > now_ns:
                    return
                self._left.append((frame, self._free_ns))
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
