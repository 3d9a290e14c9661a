"""The air speed that the ECU uses instead of the speed on the bus, which lacks the wind.

Under control the ECU estimates the logarithm of the speed in use divided by the air speed
(`contract.controller.air_speed`), and slowly corrects the speed in use until this estimate is near zero. The correction
is limited, and stays as it is while the jets are shut, while pressures are missing, or with a faulty sensor.
"""

from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from contract.arrays import Array, ArrayValue
from contract.controller.air_speed import FIRST_PERIOD, MEAN_PERIODS, feature_count, features, terms
from contract.release.manifest import Manifest

TOLERATED: Final = 0.02
"""Magnitude of the estimate below which the speed is not corrected: about the rms error of the estimate."""
MOST_REST: Final = 0.1
"""Largest magnitude of the rest, the part of the estimate that is not tolerated. A wake unlike those of the fit can
give any estimate."""
RATE: Final = 0.01
"""Share of the rest by which the speed is corrected in a period."""


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
    """The estimate of a release.

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
        """Return the estimate of a release; None for a release without one."""
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
            window: (L, S + 1) the controller's window; None if its rows are no full window of healthy sensors.
            drives: whether the jets were allowed to run in the period before.
            within: least and greatest correction with an effect: the release's range of speeds divided by the speed on
                the bus. A correction never moves away from this interval.
        """
        if not drives:
            return state if state.driven == 0 else replace(state, driven=0)
        if window is None:
            return state
        driven = min(state.driven + 1, FIRST_PERIOD)
        seen = features(window)
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
