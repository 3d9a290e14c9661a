"""The vehicle's speed through the air: its reception, and its correction by the estimate of the air speed. The speed is
used to convert pressures to coefficients, and actions to flow rates.

A release with a range of speeds needs the vehicle's speed. The checks are, in this order: authentication, end-to-end
check, age, plausibility. If a speed fails a check, the last accepted speed stays in force for a limited time, because a
vehicle hardly changes its speed in a fraction of a second.

The speed on the bus does not include the wind. Under control the ECU estimates the logarithm of the speed in use
divided by the air speed (`contract.controller.air_speed`), and slowly corrects the speed in use until this estimate is
near zero. The limited correction stays while the jets are shut, pressures are missing, or a sensor is faulty.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from can_bridge.e2e.receiver import ReceiverState, receive
from can_bridge.secoc.key import Key
from can_bridge.secoc.securing import VerifierState, verified
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import Message
from can_bridge.wire.messages import VehicleSpeed
from contract.arrays import Array, ArrayValue
from contract.config.operating_point import OperatingPoint
from contract.config.tree import Config
from contract.config.vehicle import E2eConfig, SpeedConfig
from contract.controller.air_speed import FIRST_PERIOD, MEAN_PERIODS, feature_count, features, terms
from contract.release.manifest import Manifest, SpeedRange

TOLERATED: Final = 0.02
"""Magnitude of the estimate below which the speed is not corrected: about the rms error of the estimate."""
MOST_REST: Final = 0.1
"""Limit of the rest, the part of the estimate beyond `TOLERATED`. In a wake that differs from the wakes to which the
weights were fitted, the estimate can have any value."""
RATE: Final = 0.003
"""Share of the rest by which the speed is corrected in a period. A rate of 0.01 follows the estimate's fluctuations: on
the drive `wltc-high` the drag then falls by 22.4 % instead of 25.4 % (medians of three starts)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class AirSpeedState(ArrayValue):
    """The state after a control period.

    Attributes:
        correction: ratio of the speed in use to the speed on the bus.
        driven: number of periods under control, up to `FIRST_PERIOD`.
        means: running means of the features, (F,).
    """

    correction: float = 1.0
    driven: int = 0
    means: Array = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True, kw_only=True, eq=False)
class AirSpeed:
    """The air-speed estimate of a release.

    Attributes:
        weights: weights of the estimate's terms.
        pairs: p, the number of pairs of mirrored sensors.
        most: largest correction, as a share of the speed on the bus.
    """

    weights: Array
    pairs: int
    most: float

    @classmethod
    def of(cls, manifest: Manifest, most: float) -> "AirSpeed | None":
        """Return the estimate of a release; None if the release has no estimate."""
        if manifest.air_speed is None:
            return None
        # C has the weights in float32.
        weights = np.array(manifest.air_speed, np.float32).astype(np.float64)
        return cls(weights=weights, pairs=len(manifest.sensors) // 2, most=most)

    @property
    def start(self) -> AirSpeedState:
        """The state at power-on."""
        return AirSpeedState(means=np.zeros(feature_count(self.pairs)))

    def next(
        self, state: AirSpeedState, window: Array | None, *, drives: bool, within: tuple[float, float]
    ) -> AirSpeedState:
        """Return the state after a period.

        Args:
            window: (L, S + 1) the controller's window; None if pressures or rows are missing, or a sensor is faulty.
            drives: whether the jets were allowed to run in the period before.
            within: least and greatest correction with an effect: the release's range of speeds divided by the speed on
                the bus. A correction never moves away from this interval.
        """
        if not drives:
            return state if state.driven == 0 else replace(state, driven=0)
        if window is None:
            return state
        driven, seen = min(state.driven + 1, FIRST_PERIOD), features(window)
        before = np.zeros(len(seen)) if driven == 1 else state.means
        means = before + (seen - before) / min(driven, MEAN_PERIODS)
        correction = state.correction
        if driven == FIRST_PERIOD:
            # `cumsum` adds in a fixed order, as C does; `sum` may add in another order.
            estimate = float((self.weights * terms(means, self.pairs)).cumsum()[-1])
            rest = estimate - min(max(estimate, -TOLERATED), TOLERATED)
            corrected = correction - RATE * correction * min(max(rest, -MOST_REST), MOST_REST)
            least, greatest = max(1.0 - self.most, min(1.0, within[0])), min(1.0 + self.most, max(1.0, within[1]))
            correction = min(max(corrected, least), greatest)
        return AirSpeedState(correction=correction, driven=driven, means=means)


SHORTEST_S: Final = 0.1
"""Least time in s assumed for a change of speed, so that rounding or a late frame is not taken for acceleration."""


@dataclass(frozen=True, kw_only=True)
class SpeedState:
    """The vehicle's speed after a control period.

    Attributes:
        ratio: ratio of the last accepted speed to the design speed; None if no speed is in force.
        density: density of the air in kg/m3, from the frame with this speed, or else from the operating point.
        is_off: whether the speed has left the release's range by more than the margin and has not come back into it.
        air: estimate of the air speed.
    """

    ratio: float | None = None
    density: float = 0.0
    measured_ns: int = 0
    is_off: bool = False
    verifier: VerifierState = field(default_factory=VerifierState)
    receiver: ReceiverState = field(default_factory=ReceiverState)
    air: AirSpeedState = field(default_factory=AirSpeedState)


@dataclass(frozen=True, kw_only=True)
class SpeedReception:
    """A receiver of speed frames. `design` is the operating point; `speeds` is the range relative to `design.speed`."""

    message: Message[VehicleSpeed]
    key: Key | None
    e2e: E2eConfig
    design: OperatingPoint
    speeds: SpeedRange
    config: SpeedConfig
    air: AirSpeed | None = None

    @classmethod
    def of(
        cls, manifest: Manifest, config: Config, message: Message[VehicleSpeed], key: Key | None
    ) -> "SpeedReception | None":
        """Return the reception of a release; None for a release that does not need the speed."""
        if manifest.speeds is None:
            return None
        return cls(
            message=message,
            key=key,
            e2e=config.bus.e2e,
            design=manifest.operating_point,
            speeds=manifest.speeds,
            config=config.ecu.speed,
            air=AirSpeed.of(manifest, config.ecu.speed.most_correction),
        )

    @property
    def start(self) -> SpeedState:
        """The state at power-on."""
        return SpeedState() if self.air is None else SpeedState(air=self.air.start)

    def next(self, state: SpeedState, frames: Sequence[Frame], now_ns: int) -> SpeedState:
        """Return the state after a period; `frames` are the frames of the period, oldest first."""
        spec = self.message.spec
        verifier, frames, _ = verified(state.verifier, frames, spec=spec, key=self.key)
        receiver, reception = receive(state.receiver, frames, spec=spec, config=self.e2e)
        state = replace(state, verifier=verifier, receiver=receiver)
        if now_ns < state.measured_ns:
            # The clock went back, so the age of the last accepted speed is unknown.
            state = replace(state, ratio=None)
        frame = reception.live
        stated = None if frame is None else self.message.parse(frame.data[: spec.protected])
        if frame is not None and stated is not None:
            state = self._believed(state, stated, frame.timestamp_ns - stated.age_ns, now_ns)
        if now_ns - state.measured_ns > self._oldest_ns or state.ratio is None:
            return replace(state, ratio=None)
        within = 0.0 if state.is_off else self.config.margin
        is_off = not self.speeds.slowest * (1.0 - within) <= state.ratio <= self.speeds.fastest * (1.0 + within)
        return replace(state, is_off=is_off)

    def dynamic_pressure(self, state: SpeedState) -> float | None:
        """Return the dynamic pressure in Pa at the present speed (Cp = 1); None if no speed is in force."""
        speed = self.present(state) * self.design.speed
        return None if state.ratio is None else 0.5 * state.density * speed * speed

    def present(self, state: SpeedState) -> float:
        """Return the ratio of the speed in use to the design speed, limited to the release's range; 1 if the speed on
        the bus is unknown or too far outside the range."""
        if state.ratio is None or state.is_off:
            return 1.0
        return min(max(state.ratio * state.air.correction, self.speeds.slowest), self.speeds.fastest)

    def corrected(self, state: SpeedState, window: Array | None, *, drives: bool) -> SpeedState:
        """Return the state with the next estimate of the air speed; the arguments are as in `AirSpeed.next`."""
        if self.air is None:
            return state
        ratio = state.ratio or 1.0
        within = self.speeds.slowest / ratio, self.speeds.fastest / ratio
        air = self.air.next(state.air, window, drives=drives, within=within)
        return state if air is state.air else replace(state, air=air)

    @property
    def _oldest_ns(self) -> int:
        return round(self.config.oldest_ms * 1e6)

    def _believed(self, state: SpeedState, stated: VehicleSpeed, measured_ns: int, now_ns: int) -> SpeedState:
        """Return the state with the stated speed, unless this speed is too old or not reachable from the last speed."""
        if stated.speed_m_per_s is None or not 0 <= now_ns - measured_ns <= self._oldest_ns:
            return state
        if state.ratio is not None:
            most = self.config.most_acceleration * max((now_ns - state.measured_ns) * 1e-9, SHORTEST_S)
            if abs(stated.speed_m_per_s - state.ratio * self.design.speed) > most:
                return state
        density = self.design.density if stated.density_kg_per_m3 is None else stated.density_kg_per_m3
        ratio = stated.speed_m_per_s / self.design.speed
        return replace(state, ratio=ratio, density=density, measured_ns=measured_ns)
