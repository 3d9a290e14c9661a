"""The sending end of a protected message: payload in, frame out, counter kept."""

from can_bridge.e2e import profile5 as e2e_profile5
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import MessageSpec


class E2eSender:
    """Numbers and protects the frames of one message.

    Attributes:
        counter: what the next frame will carry.
    """

    def __init__(self, spec: MessageSpec) -> None:
        self.spec = spec
        self.counter = 0

    def frame(self, data: bytes, *, now_ns: int) -> Frame:
        """The frame for a message from `can_bridge.wire.codec`.

        Raises:
            ValueError: if the data is not as long as the message.
        """
        if len(data) != self.spec.length:
            raise ValueError(f"{self.spec.name} of {len(data)} bytes: must have {self.spec.length}")
        protected = e2e_profile5.protect(data, data_id=self.spec.data_id, counter=self.counter)
        self.counter = (self.counter + 1) % e2e_profile5.COUNTER_PERIOD
        return Frame(frame_id=self.spec.frame_id, data=protected, timestamp_ns=now_ns, is_fd=True)
