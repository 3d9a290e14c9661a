"""Make of one control period's frames pressures that may be planned on, or why there are none.

In this order: authentication, the end-to-end check, the meaning, the age, the sensors' own diagnosis.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from can_bridge.e2e.profiles import profile_of
from can_bridge.e2e.receiver import ReceiverState, Reception, StreamState, receive
from can_bridge.secoc.key import Key
from can_bridge.secoc.securing import VerifierState, verified
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import Message
from can_bridge.wire.messages import Pressure, Reason
from contract.arrays import Array
from contract.config.vehicle import E2eConfig


class Received(NamedTuple):
    """What one period's frames contain.

    Attributes:
        verifier, receiver: their states after them.
        cp: usable pressures, (S,); None without.
        reading: the same in units of the design speed, in which a sensor that rests does not follow the speed.
        enable_request: of the vehicle; None if no frame came that is to be believed.
        unusable_because: why there are no usable pressures, if there are none.
        sampled_ns: when the usable ones were sampled.
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
    """How the frames of the pressure message are judged.

    Attributes:
        key: None without authentication.
        dynamic_pressure: Pa at Cp = 1 and the design speed.
        fresh_age_ns: oldest pressures that may be planned on.
    """

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
        """The newest trusted pressures of a period, or why there are none that can be used.

        Args:
            verifier, receiver: their states before it.
            dynamic_pressure: Pa at Cp = 1 at the present speed; None where that is not known.
        """
        spec = self.message.spec
        verifier, frames, none_authentic = verified(verifier, frames, spec=spec, key=self.key)
        receiver, reception = receive(receiver, frames, spec=spec, config=self.e2e)
        frame = reception.accepted
        pressure = None if frame is None else self.message.parse(frame.data[: spec.protected])
        unusable = Received(verifier, receiver, cp=None, enable_request=None, unusable_because=Reason.NONE)
        if frame is None or pressure is None or reception.live is None:
            # Control is requested by a stream that is trusted alone; its end is believed of any good frame.
            withdrawn = pressure is not None and not pressure.enable_request
            because = Reason.NOT_AUTHENTIC if none_authentic else _without_live(reception)
            return unusable._replace(enable_request=False if withdrawn else None, unusable_because=because)
        # A frame that waited in a queue, or was late before it was sent, is as old as it is.
        sampled_ns = frame.timestamp_ns - pressure.age_ns
        fresh = 0 <= now_ns - sampled_ns <= self.fresh_age_ns
        if not (fresh and all(pressure.valid)):
            because = Reason.SENSOR_INVALID if fresh else Reason.STALE
            return unusable._replace(enable_request=pressure.enable_request, unusable_because=because)
        if dynamic_pressure is None:
            return unusable._replace(enable_request=pressure.enable_request, unusable_because=Reason.NO_SPEED)
        return Received(
            verifier,
            receiver,
            cp=np.array(pressure.pressure_pa) / dynamic_pressure,
            reading=np.array(pressure.pressure_pa) / self.dynamic_pressure,
            enable_request=pressure.enable_request,
            unusable_because=Reason.NONE,
            sampled_ns=sampled_ns,
            counter=profile_of(spec).counter_of(frame.data),
        )


def _without_live(reception: Reception) -> Reason:
    """Why a stream has no frame to be used."""
    return Reason.STREAM_INVALID if reception.stream is StreamState.INVALID else Reason.STREAM_LOST
