"""The queue of received frames that the operating system keeps for a socket."""

import os
import socket
import struct
import sys
from typing import Final

_SO_MEMINFO: Final = 55
"""Linux: `SK_MEMINFO_VARS` numbers of 32 bits, of which the last one counts the drops (linux/sock_diag.h)."""
_MEMINFO: Final = struct.Struct("=9I")


def dropped(fileno: int) -> int:
    """Receptions that found a socket's queue full since it was opened; 0 where the system does not count them."""
    if sys.platform != "linux":
        return 0
    try:
        with socket.socket(fileno=os.dup(fileno)) as sock:
            return int(_MEMINFO.unpack(sock.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, _MEMINFO.size))[-1])
    except (OSError, struct.error):
        # No socket, or a kernel before 4.12.
        return 0
