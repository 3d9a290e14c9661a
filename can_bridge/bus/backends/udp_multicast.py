"""A backend for CAN over UDP multicast: python-can's backend with a parser that checks every value.

python-can 4.6 does not check the types of a datagram's values: 20 bytes with `{"data": 2**30}` allocate a gigabyte. The
C parser of msgpack (1.1.2) leaks up to 4 KB for each truncated map, so msgspec reads the datagrams. python-can's
backend also receives its own frames and, on Linux, frames of groups that other processes joined.

Two equal datagrams count as two frames. They may be different frames, because some senders send no time and ISO-TP's
sequence numbers repeat every 16 frames; and a datagram that stays on this machine never arrives twice.
"""

import socket
import sys
from collections import deque
from contextlib import suppress
from threading import Lock
from typing import Any, Final

import can
import msgspec
from can.interfaces.udp_multicast import UdpMulticastBus as PythonCanUdpMulticastBus
from can.interfaces.udp_multicast.utils import pack_message

from can_bridge.bus.interface import Rejection, UnusableReceptionError
from can_bridge.wire.frame import CLASSIC_LENGTHS, FD_LENGTHS

RECEIVE_QUEUE: Final = 1 << 22
"""Requested size in bytes of the receive buffer. Linux allocates twice this size, enough for 10,000 datagrams."""

_ECHOES: Final = 16384
"""Largest number of sent datagrams that are stored until this node receives them again."""

_SO_RCVBUFFORCE: Final = 33
_IP_MULTICAST_ALL: Final = 49
_IPV6_MULTICAST_ALL: Final = 29
"""Linux: whether a socket also receives datagrams of groups that only other sockets joined; on by default (ip(7))."""


class _Datagram(msgspec.Struct, forbid_unknown_fields=True):
    """The values that python-can packs for a message. Some senders leave out values that have a default."""

    arbitration_id: int
    data: bytes
    dlc: int | None = None
    is_extended_id: bool = True
    is_remote_frame: bool = False
    is_error_frame: bool = False
    is_fd: bool = False
    bitrate_switch: bool = False
    error_state_indicator: bool = False
    timestamp: Any = None
    channel: Any = None


_decoded: Final = msgspec.msgpack.Decoder(_Datagram).decode


def parse_datagram(datagram: bytes, *, timestamp: float = 0.0) -> can.Message | Rejection:
    """Return the message in a datagram that python-can packed, or the reason to reject the datagram. Never raises, and
    allocates no more than the datagram's size. `timestamp` is the time of reception in s, not the sender's time."""
    try:
        fields = _decoded(datagram)
    except Exception:  # noqa: BLE001 - invalid bytes may raise any error in the library
        return Rejection.GARBAGE
    length = len(fields.data) if fields.dlc is None else fields.dlc
    lengths = FD_LENGTHS if fields.is_fd else CLASSIC_LENGTHS
    if length not in lengths or len(fields.data) != (0 if fields.is_remote_frame else length):
        return Rejection.WRONG_LENGTH
    # The sender's time and channel have no meaning for the receiver.
    values = msgspec.structs.asdict(fields) | {"dlc": length, "timestamp": timestamp, "channel": None}
    try:
        return can.Message(check=True, **values)
    except ValueError:
        return Rejection.GARBAGE


class UdpMulticastBus(PythonCanUdpMulticastBus):
    """A node in this machine's multicast group. It raises `UnusableReceptionError` for unusable and own datagrams."""

    def __init__(self, channel: str = PythonCanUdpMulticastBus.DEFAULT_GROUP_IPv6, **options: Any) -> None:
        """Join the group at a multicast address, with options of python-can's backend; CAN FD is always accepted."""
        try:
            super().__init__(channel, **(options | {"fd": True}))
        except BaseException:
            # There is nothing to close. Without this call python-can would warn later that the bus was not shut down.
            can.BusABC.shutdown(self)
            raise
        sock = self._multicast._socket
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_QUEUE)
        if sys.platform == "linux":
            with suppress(PermissionError):  # without the privilege, the system's limit applies
                sock.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, RECEIVE_QUEUE)
            level, option = socket.IPPROTO_IPV6, _IPV6_MULTICAST_ALL
            if self._multicast.ip_version == 4:
                level, option = socket.IPPROTO_IP, _IP_MULTICAST_ALL
            with suppress(OSError):  # a kernel before 4.20 has no such option for IPv6
                sock.setsockopt(level, option, 0)
        self._remember_nothing()

    def _remember_nothing(self) -> None:
        self._lock = Lock()
        self._echoes: deque[bytes] = deque(maxlen=_ECHOES)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        datagram = pack_message(msg)
        with self._lock:
            self._echoes.append(datagram)
        try:
            self._multicast.send(datagram, timeout)
        except BaseException:
            self._is_echo(datagram)
            raise

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if (received := self._multicast.recv(timeout)) is None:
            return None, False
        datagram, _, timestamp = received
        message = parse_datagram(datagram, timestamp=timestamp)
        if isinstance(message, Rejection):
            raise UnusableReceptionError(message)
        # The sender's port does not show which node sent the datagram, because all nodes on this machine use one port.
        if self._is_echo(datagram):
            raise UnusableReceptionError(Rejection.OWN)
        return message, False

    def _is_echo(self, datagram: bytes) -> bool:
        """Return whether this node sent the datagram. Each sent datagram is recognised only once."""
        with self._lock:
            try:
                self._echoes.remove(datagram)
            except ValueError:
                return False
            return True
