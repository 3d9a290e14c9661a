"""The ECU's side of XCP: a state machine whose inputs are the time and the packets from the tool. Each command has a
method with the command's name, here or in `can_bridge.calibration.daq`, which returns the answer after its first byte.

A tool reads and writes one segment with two pages (`can_bridge.calibration.segment`), and reads or measures the latest
control period (`can_bridge.calibration.daq`). The ECU supports neither block mode nor flashing.
"""

import struct
import zlib
from collections.abc import Callable
from typing import Final

from can_bridge.calibration import xcp
from can_bridge.calibration.daq import EVENT_NAME, DaqLists
from can_bridge.calibration.segment import ADDRESS, Page, Segment
from can_bridge.calibration.xcp import MAX_CTO, Command, Denied, Error, SeedAnswer, XcpAccess, deny_if
from contract.controller.calibration import PACKED_BYTES, Calibration
from contract.errors import ConfigError

A2L_NAME: Final = b"stillwake"
IDLE_NS: Final = 600_000_000_000
"""Time without a command after which the connection is closed and its resource is locked. During a measurement, only
the resource is locked and the connection stays open, because a measuring tool does not have to send commands."""
REFERENCE_PROPERTIES: Final = 0x0F
WORKING_PROPERTIES: Final = REFERENCE_PROPERTIES | 0x30
"""Properties of the working page: the controller and the tool may read it independently, and the tool may write it."""


class XcpSlave:
    """A slave with one connection at a time. `random_bytes` returns the given number of unpredictable bytes."""

    def __init__(
        self, segment: Segment, answer: SeedAnswer, random_bytes: Callable[[int], bytes], *, period_ns: int
    ) -> None:
        self._segment = segment
        self.daq = DaqLists(period_ns)
        self._access = XcpAccess(answer, random_bytes)
        self._last_ns = 0
        self._to_store: Calibration | None = None
        self._end()

    def to_store(self, now_ns: int) -> Calibration | None:
        """Return the values that the tool requested to store; None if there is no such request."""
        self._end_if_idle(now_ns)
        return self._to_store

    def stored(self) -> list[bytes]:
        """Note that the calibration was stored, and return the packets that report it to the tool."""
        self._to_store = None
        return [bytes([xcp.EVENT, xcp.STORED_EVENT])] if self._is_connected else []

    def not_stored(self) -> None:
        """Note that storing failed; the tool receives no event."""
        self._to_store = None

    def command(self, now_ns: int, data: bytes) -> list[bytes]:
        """Process a packet from the tool, and return the packets to send to the tool. Never raises."""
        self._end_if_idle(now_ns)
        if not data or not (self._is_connected or data[0] == Command.CONNECT):
            return []
        self._last_ns = now_ns
        try:
            return [self._answer(data)]
        except Denied as denied:
            return [bytes([xcp.ERROR, denied.code])]

    def _answer(self, data: bytes) -> bytes:
        try:
            command = Command(data[0])
        except ValueError:
            raise Denied(Error.CMD_UNKNOWN) from None
        deny_if(len(data) < command.shortest, Error.CMD_SYNTAX)
        deny_if(command in xcp.PROTECTED and not self._access.is_unlocked, Error.ACCESS_LOCKED)
        name = command.name.lower()
        handle: Callable[[bytes], bytes | None] = getattr(self, f"_{name}", None) or getattr(self.daq, name)
        return bytes([xcp.RESPONSE]) + (handle(data) or b"")

    def _connect(self, data: bytes) -> bytes:
        self._end()
        self._is_connected = True
        versions = xcp.PROTOCOL_VERSION, xcp.TRANSPORT_VERSION
        return struct.pack("<3BH2B", xcp.RESOURCES, xcp.COMM_MODE, MAX_CTO, MAX_CTO, *versions)

    def _end_if_idle(self, now_ns: int) -> None:
        if self._is_connected and now_ns - self._last_ns > IDLE_NS:
            if self.daq.is_running:
                self._to_store = None
                self._access.lock()
            else:
                self._end()

    def _end(self) -> None:
        self._is_connected = False
        self.daq.free()
        self._to_store = None
        self._access.lock()
        self._address = 0
        self._identification = b""
        self._page = Page.WORKING

    def _disconnect(self, data: bytes) -> None:
        self._end()

    def _get_status(self, data: bytes) -> bytes:
        session = 0 if self._to_store is None else xcp.STORE_REQUEST
        session |= xcp.DAQ_RUNNING if self.daq.is_running else 0
        return bytes([session, self._access.protected, 0, 0, 0])

    def _synch(self, data: bytes) -> None:
        raise Denied(Error.CMD_SYNCH)

    def _get_comm_mode_info(self, data: bytes) -> bytes:
        """Answer that the slave accepts neither blocks of commands nor a queue of commands."""
        return bytes([0, 0, 0, 0, 0, 0, xcp.DRIVER_VERSION])

    def _get_id(self, data: bytes) -> bytes:
        """Offer an identification of type 0 (text) or 1 (name of the A2L file); the tool reads it by UPLOAD."""
        self._identification = A2L_NAME if data[1] in (0, 1) else b""
        return struct.pack("<3xI", len(self._identification))

    def _get_daq_event_info(self, data: bytes) -> bytes:
        answer = self.daq.get_daq_event_info(data)
        self._identification = EVENT_NAME
        return answer

    def _set_request(self, data: bytes) -> None:
        deny_if(data[1] != xcp.STORE_REQUEST, Error.OUT_OF_RANGE)
        self._to_store = self._segment.in_force

    def _get_seed(self, data: bytes) -> bytes:
        return self._access.seed(data[1], data[2])

    def _unlock(self, data: bytes) -> bytes:
        if not self._access.unlock(data[1], data[2:]):
            self._end()
            raise Denied(Error.ACCESS_LOCKED)
        return bytes([self._access.protected])

    def _set_mta(self, data: bytes) -> None:
        self._address = _address(data)
        self._identification = b""

    def _upload(self, data: bytes) -> bytes:
        length = _length(data[1], MAX_CTO - 1)
        if self._identification:
            piece, self._identification = self._identification[:length], self._identification[length:]
            return piece
        piece = self._read(self._address, length)
        self._address += length
        return piece

    def _short_upload(self, data: bytes) -> bytes:
        length, address = _length(data[1], MAX_CTO - 1), _address(data)
        piece = self._read(address, length)
        self._identification = b""
        self._address = address + length
        return piece

    def _build_checksum(self, data: bytes) -> bytes:
        length = int.from_bytes(data[4:8], "little")
        checksum = zlib.crc32(self._read(self._address, length))
        self._address += length
        return struct.pack("<B2xI", xcp.CRC_32, checksum)

    def _download(self, data: bytes) -> None:
        length = _length(data[1], MAX_CTO - 2)
        deny_if(len(data) < 2 + length, Error.CMD_SYNTAX)
        _check_inside(self._address, length)
        deny_if(self._page is not Page.WORKING, Error.WRITE_PROTECTED)
        try:
            self._segment.write(self._address - ADDRESS, data[2 : 2 + length])
        except ConfigError:
            raise Denied(Error.OUT_OF_RANGE) from None
        self._address += length

    def _set_cal_page(self, data: bytes) -> None:
        mode, segment = data[1], data[2]
        deny_if(not mode & (xcp.ECU_MODE | xcp.XCP_MODE), Error.MODE_NOT_VALID)
        if not mode & xcp.ALL_MODE:
            _check_segment(segment)
        page = _page(data[3])
        if mode & xcp.ECU_MODE:
            self._segment.page = page
        if mode & xcp.XCP_MODE:
            self._page = page

    def _get_cal_page(self, data: bytes) -> bytes:
        deny_if(data[1] not in (xcp.ECU_MODE, xcp.XCP_MODE), Error.MODE_NOT_VALID)
        _check_segment(data[2])
        page = self._segment.page if data[1] == xcp.ECU_MODE else self._page
        return bytes([0, 0, page])

    def _get_pag_processor_info(self, data: bytes) -> bytes:
        return bytes([1, 0])  # one segment, no properties

    def _get_segment_info(self, data: bytes) -> bytes:
        mode, info = data[1], data[3]
        _check_segment(data[2])
        if mode == 0 and info in (0, 1):
            return struct.pack("<3xI", (ADDRESS, PACKED_BYTES)[info])
        if mode == 1:
            return bytes([len(Page), 0, 0, 0, 0])
        raise Denied(Error.OUT_OF_RANGE)

    def _get_page_info(self, data: bytes) -> bytes:
        _check_segment(data[2])
        properties = WORKING_PROPERTIES if _page(data[3]) is Page.WORKING else REFERENCE_PROPERTIES
        return bytes([properties, 0])

    def _copy_cal_page(self, data: bytes) -> None:
        _check_segment(data[1])
        _check_segment(data[3])
        source, target = _page(data[2]), _page(data[4])
        deny_if(target is Page.REFERENCE, Error.WRITE_PROTECTED)
        if source is Page.REFERENCE:
            self._segment.copy_reference()

    def _read(self, address: int, length: int) -> bytes:
        if (measured := self.daq.read(address, length)) is not None:
            return measured
        _check_inside(address, length)
        return self._segment.read(self._page, address - ADDRESS, length)


def _length(count: int, greatest: int) -> int:
    deny_if(not 0 < count <= greatest, Error.OUT_OF_RANGE)
    return count


def _address(data: bytes) -> int:
    """Return the address in a command, which follows the address extension in byte 3."""
    deny_if(data[3] != 0, Error.OUT_OF_RANGE)
    return int.from_bytes(data[4:8], "little")


def _check_inside(address: int, length: int) -> None:
    deny_if(not ADDRESS <= address <= address + length <= ADDRESS + PACKED_BYTES, Error.ACCESS_DENIED)


def _check_segment(number: int) -> None:
    deny_if(number != 0, Error.SEGMENT_NOT_VALID)


def _page(number: int) -> Page:
    try:
        return Page(number)
    except ValueError:
        raise Denied(Error.PAGE_NOT_VALID) from None
