"""One frame in the notation of candump and cansend (can-utils)."""

import re
from typing import Final

import can

from can_bridge.wire.frame import CLASSIC_LENGTHS, FD_LENGTHS, MAX_EXTENDED_ID, MAX_FRAME_ID
from contract.errors import BusError

_FRAME: Final = re.compile(
    r"(?P<id>[0-9A-F]{3}|[0-9A-F]{8})#(?:(?P<remote>R)(?P<length>[0-8]?)|(?:#(?P<flags>[0-3]))?(?P<data>(?:[0-9A-F]{2}\.?)*))",
    re.IGNORECASE | re.ASCII,
)

NOTATION: Final = (
    "must be ID#DATA, ID#R or ID#R<length> of a remote frame, or ID##<flags>DATA of CAN FD: three or eight hexadecimal "
    "digits of an identifier, flags 1 bit-rate switch, 2 error state, two digits a byte"
)


def parse(text: str) -> can.Message:
    """The message, not stamped with a time.

    Raises:
        BusError: for anything else, or what no wire carries.
    """
    match = _FRAME.fullmatch(text)
    if match is None:
        raise BusError(f"{text}: {NOTATION}")
    identifier, flags = match["id"], int(match["flags"] or 0)
    is_fd, is_remote, is_extended = match["flags"] is not None, match["remote"] is not None, len(identifier) == 8
    data = bytes.fromhex((match["data"] or "").replace(".", ""))
    largest = MAX_EXTENDED_ID if is_extended else MAX_FRAME_ID
    if int(identifier, 16) > largest:
        raise BusError(f"{text}: the identifier must be in 0..{largest:X}")
    lengths = FD_LENGTHS if is_fd else CLASSIC_LENGTHS
    if len(data) not in lengths:
        raise BusError(f"{text}: has {len(data)} bytes; a frame of its kind has {', '.join(map(str, lengths))}")
    return can.Message(
        arbitration_id=int(identifier, 16),
        is_extended_id=is_extended,
        is_remote_frame=is_remote,
        dlc=int(match["length"] or 0) if is_remote else len(data),
        data=data,
        is_fd=is_fd,
        bitrate_switch=bool(flags & 1),
        error_state_indicator=bool(flags & 2),
    )
