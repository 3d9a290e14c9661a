"""The conversion between our frames and python-can's messages."""

from copy import copy

import can

from can_bridge.bus.interface import Rejection
from can_bridge.wire.frame import CLASSIC_LENGTHS, FD_LENGTHS, Frame


def to_message(frame: Frame) -> can.Message:
    """Return the frame as a message. The message's time is a float in s, exact to the ns up to a few weeks."""
    return can.Message(
        arbitration_id=frame.frame_id,
        data=frame.data,
        timestamp=frame.timestamp_ns / 1e9,
        is_extended_id=frame.is_extended,
        is_fd=frame.is_fd,
        bitrate_switch=frame.is_fd,
    )


def frame_of(message: can.Message) -> Frame | Rejection:
    """Return the frame in a message, or why there is none. Never raises. A frame does not state the bit-rate switch."""
    if message.is_error_frame:
        return Rejection.ERROR_FRAME
    if message.is_remote_frame:
        return Rejection.REMOTE
    is_fd = bool(message.is_fd)
    # Only the difference between the stated and the actual length shows that a backend has read a truncated line.
    if message.dlc != len(message.data) or len(message.data) not in (FD_LENGTHS if is_fd else CLASSIC_LENGTHS):
        return Rejection.WRONG_LENGTH
    # A backend may deliver values of any type and range, and a float would pass the check of the range.
    if not isinstance(message.arbitration_id, int):
        return Rejection.GARBAGE
    try:
        return Frame(
            frame_id=message.arbitration_id,
            data=bytes(message.data),
            timestamp_ns=round(message.timestamp * 1e9),
            is_fd=is_fd,
            is_extended=bool(message.is_extended_id),
        )
    except (ValueError, OverflowError, TypeError):
        return Rejection.GARBAGE


def data_frame_of(message: can.Message) -> Frame | None:
    """Return the data frame in a message, with an 11- or 29-bit identifier; None for remote, error and invalid frames.
    A time below 0 becomes 0; a log has such times before a trigger."""
    if message.timestamp < 0.0:
        message = copy(message)
        message.timestamp = 0.0
    frame = frame_of(message)
    return frame if isinstance(frame, Frame) else None


def id_text(frame: Frame) -> str:
    """Return an identifier as candump writes it: three hexadecimal digits, or eight for 29 bits."""
    return f"{frame.frame_id:08X}" if frame.is_extended else f"{frame.frame_id:03X}"
