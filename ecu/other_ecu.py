"""Detection of another ECU on the bus. A node does not receive its own frames, so any ECU frame that it receives comes
from another ECU.

Two ECUs on one bus would both drive the jets, in turn. So an ECU keeps the jets shut until it has received no frame of
another ECU for `SILENCE_NS`. With a key only authentic frames count: a forged frame does not shut the jets, but a
recorded authentic frame that is sent again does.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from can_bridge.e2e.profiles import profile_of
from can_bridge.secoc.key import Key
from can_bridge.secoc.securing import verify
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import MessageSet
from can_bridge.wire.message_specs import MessageSpec
from can_bridge.wire.messages import Reason

SILENCE_NS: Final = 1_000_000_000
"""Time in ns without a frame of another ECU after which that ECU counts as gone."""


@dataclass(frozen=True, kw_only=True)
class OtherEcu:
    """The state after a control period. `until_ns` is the time until which another ECU counts as present, or None."""

    frames: int = 0
    until_ns: int | None = None

    @property
    def fault(self) -> Reason | None:
        """The fault for which the ECU must switch itself off, or None."""
        return None if self.until_ns is None else Reason.OTHER_ECU

    def next(self, heard: int, step_ns: int) -> "OtherEcu":
        """Return the state after a step in which `heard` frames of another ECU were received."""
        if heard:
            return OtherEcu(frames=self.frames + heard, until_ns=step_ns + SILENCE_NS)
        is_gone = self.until_ns is not None and step_ns > self.until_ns
        return replace(self, until_ns=None) if is_gone else self


def heard_of_another_ecu(frames: Sequence[Frame], messages: MessageSet, key: Key | None) -> int:
    """Return the number of received frames that another ECU sent: valid JetCommands and EcuStatuses."""
    specs = (messages.command.spec, messages.status.spec)
    return sum(_is_valid(frame, spec, key) for frame in frames for spec in specs if spec.names(frame))


def _is_valid(frame: Frame, spec: MessageSpec, key: Key | None) -> bool:
    authentic = key is None or verify(frame.data, spec, key) is not None
    return authentic and profile_of(spec).check(frame.data[: spec.protected], data_id=spec.data_id)
