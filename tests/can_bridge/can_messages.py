"""Any frame and any message that a wire carries."""

import can
from hypothesis import strategies as st

from can_bridge.wire.frame import CLASSIC_LENGTHS, FD_LENGTHS, Frame

_REPEATED = st.sampled_from([b"\x00", b"\xff", b"\x0f", b"\xf0", b"\x1e", b"\xe1", b"\x78", b"\x87"])
_PAYLOADS = st.binary(max_size=64) | _REPEATED.map(lambda byte: byte * 64)


@st.composite
def frames(draw: st.DrawFn, formats: st.SearchStrategy[bool] = st.booleans()) -> Frame:  # noqa: B008
    """A data frame, in CAN FD where `formats` says so; many have long runs of equal bits, for their stuff bits."""
    fd, extended = draw(formats), draw(st.booleans())
    length = draw(st.sampled_from(FD_LENGTHS if fd else CLASSIC_LENGTHS))
    frame_id, data = draw(st.integers(0, 0x1FFFFFFF if extended else 0x7FF)), draw(_PAYLOADS).ljust(length, b"\0")
    return Frame(frame_id=frame_id, data=data[:length], is_fd=fd, is_extended=extended)


@st.composite
def can_messages(draw: st.DrawFn) -> can.Message:
    """A data or remote frame of either format, with an identifier of either length; not stamped."""
    kind, is_extended = draw(st.sampled_from(["classic", "fd", "remote"])), draw(st.booleans())
    is_fd = kind == "fd"
    length = draw(st.sampled_from(FD_LENGTHS if is_fd else range(9)))
    return can.Message(
        arbitration_id=draw(st.integers(0, 0x1FFFFFFF if is_extended else 0x7FF)),
        is_extended_id=is_extended,
        is_remote_frame=kind == "remote",
        dlc=length,
        data=None if kind == "remote" else draw(st.binary(min_size=length, max_size=length)),
        is_fd=is_fd,
        is_rx=draw(st.booleans()),
        bitrate_switch=is_fd and draw(st.booleans()),
        error_state_indicator=is_fd and draw(st.booleans()),
        channel=0,
    )
