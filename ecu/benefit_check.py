"""The check whether control helps: it compares the pressures under control with the pressures while the jets were shut.

docs/explanation/what-shuts-the-jets.md explains the two compared quantities, the test with shut jets, and when the
fault latches. The speed, and with it the wake, may have changed since the wake without control was measured. So each
period's values are divided by the values of the release's own wake without jets at the period's speed.
"""

from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, Final

import numpy as np

from can_bridge.wire.messages import Reason
from contract.arrays import Array
from contract.config.vehicle import BenefitCheckConfig
from contract.release.manifest import Manifest
from contract.sensor_layout import SAME_PLACE
from ecu.fit import positions_of

MOVED: Final = 0.1
"""Change of the speed that ends a test, as a share of the design speed: a test is valid only for its own speed."""
PATIENCE: Final = 6
"""Total duration of the tests after which the fault NOT_HELPING latches, as a multiple of `wake_periods`: 18 s with the
default settings. In this time the vehicle may leave a speed at which control does harm."""
UNSTATED: Final = ((1.0, -1e-3, 1e-3),)
"""Value of `BenefitCheck.resting` for a release without these data; with it, `_helps` uses only the measured means."""


@dataclass(frozen=True, kw_only=True)
class BenefitCheckState:
    """The state after a control period. A period without pressures changes no mean. "Swing" is the mean magnitude of
    the pressure differences between mirrored sensors.

    Attributes:
        waking: number of periods with shut jets that the wake still needs to recover from control.
        rested: number of measured periods without control, outside tests; counts up to `BenefitCheck.proven`.
        resting_suction, resting_swing: mean suction on the base and mean swing without control, divided by the values
            of the release's own wake without jets.
        driven: number of measured periods under control; counts up to `ecu.benefit_check.first_period`.
        suction, swing: the same means under control.
        doubt: number of periods in which control did not help minus number of periods in which it helped, at least 0.
        tested_at: speed at which the present test began, divided by the design speed; 0 if there is no test.
        spent: number of periods in tests minus number of periods in which control helped, 0 to `BenefitCheck.patience`.
    """

    waking: int = 0
    rested: int = 0
    resting_suction: float = 0.0
    resting_swing: float = 0.0
    driven: int = 0
    suction: float = 0.0
    swing: float = 0.0
    doubt: int = 0
    tested_at: float = 0.0
    spent: int = 0

    @property
    def tests(self) -> bool:
        """Whether a test is in progress; the jets must then be shut."""
        return self.tested_at > 0.0


_NOT_DRIVEN: Final[dict[str, Any]] = {"driven": 0, "suction": 0.0, "swing": 0.0, "doubt": 0}
"""Values of the means under control, and of the doubt, before control begins."""


@dataclass(frozen=True, kw_only=True)
class BenefitCheck:
    """The benefit check of one release.

    Attributes:
        base: (B,) indices of the release's B sensors on the base.
        pairs: (P, 2) indices of the P pairs of mirrored sensors.
        resting: (K, 3) the release's wake without jets at K increasing speeds. A row has the speed divided by the
            design speed, the mean base pressure (below zero) in Cp, and the swing in Cp (see `BenefitCheckState`).
    """

    base: tuple[int, ...]
    pairs: tuple[tuple[int, int], ...]
    config: BenefitCheckConfig
    resting: tuple[tuple[float, float, float], ...] = UNSTATED

    @classmethod
    def of(cls, manifest: Manifest, config: BenefitCheckConfig) -> "BenefitCheck | None":
        """Return the check of a release; None if it is disabled, or base sensors or mirrored sensors are missing."""
        base = tuple(place for place, name in enumerate(manifest.sensors) if name.startswith("base_"))
        pairs = mirrored_pairs(manifest)
        if not (config.enabled and base and pairs):
            return None
        return cls(base=base, pairs=pairs, config=config, resting=resting_of(manifest))

    @property
    def proven(self) -> int:
        """The number of periods without control whose means no longer depend on the time before power-on."""
        return self.config.wake_periods + self.config.mean_periods

    @property
    def patience(self) -> int:
        """The total number of periods in tests after which the fault latches."""
        return PATIENCE * self.config.wake_periods

    def next(
        self, state: BenefitCheckState, cp: Array | None, *, drives: bool, speed: float = 1.0
    ) -> tuple[BenefitCheckState, Reason | None]:
        """Return the state after a period, and the reason why the ECU must switch itself off, or None.

        Args:
            cp: (S,) pressures of this period at the S sensors, as Cp; None if there are none.
            drives: whether the jets were allowed to run in the period before.
            speed: ratio of the vehicle's speed to the design speed.
        """
        if state.tests:
            return self._tested(state, cp, speed)
        if drives:
            return self._driven(state, cp, speed), None
        waking = max(0, state.waking - 1)
        after = replace(state, waking=waking, **_NOT_DRIVEN)
        if cp is not None and not waking:
            after = replace(after, rested=min(state.rested + 1, self.proven))
            after = self._rested(after, cp, speed, min(after.rested, self.config.mean_periods))
        return after, None

    def _driven(self, state: BenefitCheckState, cp: Array | None, speed: float) -> BenefitCheckState:
        config = self.config
        state = replace(state, waking=config.wake_periods)
        if cp is None:
            return state
        suction, swing = self._measured(cp, speed)
        driven = min(state.driven + 1, config.first_period)
        over = min(driven, config.mean_periods)
        suction = state.suction + (suction - state.suction) / over
        swing = state.swing + (swing - state.swing) / over
        after = replace(state, driven=driven, suction=suction, swing=swing)
        if driven < config.first_period or state.rested == 0:
            return after
        helps = self._helps(after)
        after = replace(after, doubt=self._doubt(state.doubt, helps), spent=max(0, state.spent - helps))
        return after if after.doubt < config.doubt_periods else replace(after, tested_at=speed)

    def _tested(
        self, state: BenefitCheckState, cp: Array | None, speed: float
    ) -> tuple[BenefitCheckState, Reason | None]:
        """Compute `next` in a test. Its means without control cover all periods of the test, up to `wake_periods`."""
        if cp is None:
            return state, None
        config = self.config
        waking, spent = max(0, state.waking - 1), min(state.spent + 1, self.patience)
        over = config.wake_periods - waking
        after = self._rested(replace(state, waking=waking, spent=spent), cp, speed, over)
        goes_on = False
        if over >= min(config.first_period, config.wake_periods):
            after = replace(after, doubt=self._doubt(state.doubt, self._helps(after)))
            goes_on = after.doubt == 0 or abs(speed - state.tested_at) >= MOVED
        latches = not goes_on and spent >= self.patience
        if goes_on or latches:
            after = replace(after, tested_at=0.0, **_NOT_DRIVEN)
        return after, Reason.NOT_HELPING if latches else None

    def _doubt(self, doubt: int, helps: bool) -> int:
        return max(0, doubt - 1) if helps else min(doubt + 1, self.config.doubt_periods)

    def _helps(self, state: BenefitCheckState) -> bool:
        config = self.config
        suction, swing = state.resting_suction, state.resting_swing
        if state.rested < self.proven:
            suction, swing = max(suction, 1.0), max(swing, 1.0)
        return suction - state.suction >= config.least_gain * abs(suction) and state.swing <= config.most_swing * swing

    def _rested(self, state: BenefitCheckState, cp: Array, speed: float, over: int) -> BenefitCheckState:
        """Add this period's values to the means without control; the weight of the new values is 1 / `over`."""
        suction, swing = self._measured(cp, speed)
        suction = state.resting_suction + (suction - state.resting_suction) / over
        swing = state.resting_swing + (swing - state.resting_swing) / over
        return replace(state, resting_suction=suction, resting_swing=swing)

    def _measured(self, cp: Array, speed: float) -> tuple[float, float]:
        """Return suction and swing divided by the release's values without jets; C sums in the same order."""
        base = swing = 0.0
        for place in self.base:
            base += float(cp[place])
        for one, other in self.pairs:
            swing += abs(float(cp[one]) - float(cp[other]))
        resting_base, resting_swing = self._stated(speed)
        return base / len(self.base) / resting_base, swing / len(self.pairs) / resting_swing

    def _stated(self, speed: float) -> tuple[float, float]:
        """Return the base pressure and the swing in Cp of the release's wake without jets at this speed."""
        before = self.resting[0]
        for after in self.resting:
            if speed < after[0]:
                share = (speed - before[0]) / (after[0] - before[0]) if after[0] > before[0] else 0.0
                return before[1] + share * (after[1] - before[1]), before[2] + share * (after[2] - before[2])
            before = after
        return before[1], before[2]


def resting_of(manifest: Manifest) -> tuple[tuple[float, float, float], ...]:
    """Return `BenefitCheck.resting` of a release."""
    stated = manifest.resting
    return UNSTATED if stated is None else tuple(zip(stated.speeds, stated.base, stated.swing, strict=True))


def mirrored_pairs(manifest: Manifest) -> tuple[tuple[int, int], ...]:
    """Return the pairs of indices of a release's mirrored sensors; empty if the sensors' positions are unknown."""
    positions = positions_of(manifest)
    if positions is None:
        return ()
    images = positions * [1.0, -1.0]
    places = combinations(range(len(positions)), 2)
    return tuple(pair for pair in places if np.abs(images[pair[0]] - positions[pair[1]]).max() <= SAME_PLACE)
