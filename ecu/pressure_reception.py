"""The conversion of a control period's frames to usable pressures, or to the reason why there are none.

The checks are, in this order: authentication, end-to-end check, content, age, the sensors' own diagnosis.

Another ECU on the bus is also detected here. A node does not receive its own frames, so any ECU frame that it receives
comes from another ECU. Two ECUs on one bus would drive the jets alternately. So an ECU keeps the jets shut until it
has received no frame of another ECU for `SILENCE_NS`. With a key only authentic frames count: a forged frame does not
shut the jets, but a recorded authentic frame that is sent again does.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from can_bridge.e2e.profiles import profile_of
from can_bridge.e2e.receiver import ReceiverState, StreamState, receive
from can_bridge.secoc.key import Key
from can_bridge.secoc.securing import VerifierState, verified, verify
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import Message, MessageSet
from can_bridge.wire.message_specs import MessageSpec
from can_bridge.wire.messages import Pressure, Reason
from contract.arrays import Array
from contract.config.vehicle import E2eConfig


class Received(NamedTuple):
    """The result of receiving one period's frames.

    Attributes:
        verifier, receiver: states of the authentication and of the E2E receiver after these frames.
        cp: (S,) usable pressures at the S sensors, as Cp, sampled at `sampled_ns`; None if there are none.
        reading: (S,) the same pressures, scaled with the design speed: a stuck sensor's reading is then constant.
        enable_request: enable request of the vehicle; None if no frame arrived that may change it.
    """

    verifier: VerifierState
    receiver: ReceiverState
    cp: Array | None
    enable_request: bool | None
    unusable_because: Reason
    reading: Array | None = None
    sampled_ns: int | None = None
    counter: int | None = None


@dataclass(frozen=True, kw_only=True)
class PressureReception:
    """The reception of pressure frames. `dynamic_pressure` is in Pa, at design speed; `fresh_age_ns` limits the age."""

    message: Message[Pressure]
    key: Key | None
    e2e: E2eConfig
    dynamic_pressure: float
    fresh_age_ns: int

    def of(
        self,
        frames: Sequence[Frame],
        now_ns: int,
        *,
        verifier: VerifierState,
        receiver: ReceiverState,
        dynamic_pressure: float | None,
    ) -> Received:
        """Return the newest trusted pressures of a period, or the reason why there are none. `dynamic_pressure` is the
        pressure in Pa for Cp = 1 at the present speed; None if no speed is in force."""
        spec = self.message.spec
        verifier, frames, none_authentic = verified(verifier, frames, spec=spec, key=self.key)
        receiver, reception = receive(receiver, frames, spec=spec, config=self.e2e)
        frame = reception.accepted
        pressure = None if frame is None else self.message.parse(frame.data[: spec.protected])
        unusable = Received(verifier, receiver, cp=None, enable_request=None, unusable_because=Reason.NONE)
        if frame is None or pressure is None or reception.live is None:
            # Only a trusted stream can request control, but any accepted frame can withdraw the request.
            withdrawn = pressure is not None and not pressure.enable_request
            lost = Reason.STREAM_INVALID if reception.stream is StreamState.INVALID else Reason.STREAM_LOST
            because = Reason.NOT_AUTHENTIC if none_authentic else lost
            return unusable._replace(enable_request=False if withdrawn else None, unusable_because=because)
        # The age in a frame is counted from the sampling, so it includes the delays before sending.
        sampled_ns = frame.timestamp_ns - pressure.age_ns
        requested = unusable._replace(enable_request=pressure.enable_request)
        if not 0 <= now_ns - sampled_ns <= self.fresh_age_ns:
            return requested._replace(unusable_because=Reason.STALE)
        if not all(pressure.valid):
            return requested._replace(unusable_because=Reason.SENSOR_INVALID)
        if dynamic_pressure is None:
            return requested._replace(unusable_because=Reason.NO_SPEED)
        pressures, counter = np.array(pressure.pressure_pa), profile_of(spec).counter_of(frame.data)
        cp, reading = pressures / dynamic_pressure, pressures / self.dynamic_pressure
        return requested._replace(cp=cp, reading=reading, sampled_ns=sampled_ns, counter=counter)


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
        if self.until_ns is None:
            return self
        # If the clock went back, the required time of silence begins now.
        until_ns = min(self.until_ns, step_ns + SILENCE_NS)
        return replace(self, until_ns=None if step_ns > until_ns else until_ns)


def heard_of_another_ecu(frames: Sequence[Frame], messages: MessageSet, key: Key | None) -> int:
    """Return the number of received frames that another ECU sent: valid JetCommands and EcuStatuses."""
    specs = (messages.command.spec, messages.status.spec)
    return sum(_is_valid(frame, spec, key) for frame in frames for spec in specs if spec.names(frame))


def _is_valid(frame: Frame, spec: MessageSpec, key: Key | None) -> bool:
    authentic = key is None or verify(frame.data, spec, key) is not None
    return authentic and profile_of(spec).check(frame.data[: spec.protected], data_id=spec.data_id)
