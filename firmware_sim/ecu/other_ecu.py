"""Frames that only another ECU can have sent: a node does not hear its own.

Two ECUs on one bus would take turns in driving the jets. With a key the frame must be authentic, so that a forgery does
not shut the jets; an old frame of ours that somebody repeats does.
"""

from can_bridge.e2e.profiles import profile_of
from can_bridge.secoc.key import Key
from can_bridge.secoc.securing import verify
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import MessageSet


def is_of_another_ecu(frame: Frame, messages: MessageSet, key: Key | None) -> bool:
    """Whether a received frame is a sound command or status, of the set in use."""
    for spec in (messages.command.spec, messages.status.spec):
        if spec.names(frame):
            authentic = key is None or verify(frame.data, spec, key) is not None
            return authentic and profile_of(spec).check(frame.data[: spec.protected], data_id=spec.data_id)
    return False
