"""Any message that a wire carries."""

import can
from hypothesis import strategies as st

from can_bridge.wire.frame import FD_LENGTHS


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
