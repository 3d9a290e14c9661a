"""The settings of an ISO-TP endpoint."""

from dataclasses import dataclass
from typing import Final

from can_bridge.isotp.control_info import CLASSIC_LENGTH

_SECOND_NS: Final = 1_000_000_000


@dataclass(frozen=True, kw_only=True)
class IsoTpSettings:
    """One end of a connection.

    Attributes:
        receive_id: identifier of the frames from the other end.
        send_id: identifier of the frames of this end.
        is_extended: whether both identifiers have 29 bits rather than 11.
        frame_length: largest data length of a sent frame in bytes: 8, or a greater CAN FD length if `is_fd`.
        is_fd: whether to send CAN FD frames; CAN FD frames and classic frames are received.
        block_size: number of frames after which the other end must wait for this end's flow control, 0 for never.
        separation_code: code byte of the least time between the frames that the other end sends.
        queue: largest number of messages that wait to be sent, or to be taken.
        burst: largest number of frames of one `poll`, so that a controller's transmit buffers do not overflow.
        n_bs_ns: longest wait for the other end's flow control, in ns.
        n_cr_ns: longest wait for the other end's next frame, in ns.
        max_waits: largest number of consecutive WAIT answers of the other end.
    """

    receive_id: int
    send_id: int
    is_extended: bool = False
    frame_length: int = 64
    is_fd: bool = True
    block_size: int = 0
    separation_code: int = 0
    queue: int = 8
    burst: int = 8
    n_bs_ns: int = _SECOND_NS
    n_cr_ns: int = _SECOND_NS
    max_waits: int = 100


def classic(*, receive_id: int, send_id: int, is_extended: bool = False) -> IsoTpSettings:
    """Return the settings for a bus without CAN FD."""
    return IsoTpSettings(
        receive_id=receive_id, send_id=send_id, is_extended=is_extended, frame_length=CLASSIC_LENGTH, is_fd=False
    )
