"""Whether control helps: the pressure on the base under control against what it was before, with the jets shut.

A controller made for another speed, another body or another delay can raise drag, with every frame and every pressure
in order. Two means tell, both over two shedding cycles. Where control helps the base's suction falls; where it only
bends the wake aside, the pressures of mirrored sensors differ more than without control. What either was without
control is measured on the vehicle itself, whenever the jets have been shut for long enough. Since then the speed may
have changed, and the wake with it, so both means are in units of what the release's own wake has at the speed of each
period. After power-on no one knows for how long the jets had been shut: a reset under control leaves a calmed wake
behind. Until the vehicle has measured for long enough, the release's wake counts where it is the larger one.

Control that does not help for a shedding cycle is only suspected: it is compared with another time, and by a speed that
may be wrong. So the jets are shut, and the wake is measured without them at this very speed. If that wake is the worse
one, control goes on, and so it does at another speed, of which the test says nothing. Otherwise the fault latches in
the end. A new request for control tries again.
"""

from dataclasses import dataclass, replace
from itertools import combinations
from typing import Final

import numpy as np

from can_bridge.wire.messages import Reason
from contract.arrays import Array
from contract.config.vehicle import BenefitCheckConfig
from contract.release.manifest import Manifest
from contract.sensor_layout import SAME_PLACE
from ecu.fit import positions_of

_ON_BASE: Final = "base_"
"""How the names of sensors on a body's base begin."""
MOVED: Final = 0.1
"""Change of the speed that ends a test, in design speeds: the wake has become another one."""
PATIENCE: Final = 6
"""Longest test, in `wake_periods`: 18 s. The jets are shut meanwhile; a speed at which control hurts may pass."""
UNSTATED: Final = ((1.0, -1e-3, 1e-3),)
"""The wake of a release that states none, in Cp: smaller than any, so that the vehicle's own always counts."""


@dataclass(frozen=True, kw_only=True)
class BenefitCheckState:
    """The state after a control period. Periods without pressures change no mean.

    Attributes:
        waking: periods with the jets shut until the wake is that without control; none at power-on.
        rested: periods that the means without control rest on, up to `BenefitCheck.proven`.
        resting_suction, resting_swing: the means without control, in units of the release's own wake.
        driven: the same under control, up to `ecu.benefit_check.first_period`.
        suction, swing: the means under control.
        doubt: periods in which control did not help less those in which it did.
        tested_at: the speed at which a test began, in design speeds; 0 without a test.
        spent: periods of tests less those in which control helped, up to `BenefitCheck.patience`.
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
        """Whether the jets must be shut for a test."""
        return self.tested_at > 0.0


@dataclass(frozen=True, kw_only=True)
class BenefitCheck:
    """The check of one release.

    Attributes:
        base: (B,) places of the sensors on the base among the release's.
        pairs: (P, 2) of mirrored sensors among them.
        resting: (K, 3) rising speeds in design speeds, and there the mean base pressure, below zero, and the mean
            magnitude of the differences of mirrored sensors, both in Cp.
    """

    base: tuple[int, ...]
    pairs: tuple[tuple[int, int], ...]
    config: BenefitCheckConfig
    resting: tuple[tuple[float, float, float], ...] = UNSTATED

    @classmethod
    def of(cls, manifest: Manifest, config: BenefitCheckConfig) -> "BenefitCheck | None":
        """The check of a release; None where none of its sensors is on the base, or none has its mirror image."""
        base = tuple(place for place, name in enumerate(manifest.sensors) if name.startswith(_ON_BASE))
        pairs = mirrored_pairs(manifest)
        if not (config.enabled and base and pairs):
            return None
        return cls(base=base, pairs=pairs, config=config, resting=resting_of(manifest))

    @property
    def proven(self) -> int:
        """Periods after which the means without control hold nothing of what was before power-on: the wake sheds as
        before, and a mean has been taken of it."""
        return self.config.wake_periods + self.config.mean_periods

    @property
    def patience(self) -> int:
        """Periods of tests after which the fault latches."""
        return PATIENCE * self.config.wake_periods

    def next(
        self, state: BenefitCheckState, cp: Array | None, *, drives: bool, speed: float = 1.0
    ) -> tuple[BenefitCheckState, Reason | None]:
        """The state after a period, and why the ECU must switch itself off, if it must.

        Args:
            cp: (S,) this period's pressures; None without any.
            drives: whether the jets could run up to now.
            speed: of the vehicle, in design speeds.
        """
        if state.tests:
            return self._tested(state, cp, speed)
        if drives:
            return self._driven(state, cp, speed), None
        waking = max(0, state.waking - 1)
        after = replace(state, waking=waking, driven=0, suction=0.0, swing=0.0, doubt=0)
        if cp is not None and not waking:
            rested = min(state.rested + 1, self.proven)
            over = min(rested, self.config.mean_periods)
            after = self._rested(replace(after, rested=rested), cp, speed, over)
        return after, None

    def _driven(self, state: BenefitCheckState, cp: Array | None, speed: float) -> BenefitCheckState:
        config = self.config
        state = replace(state, waking=config.wake_periods)
        if cp is None:
            return state
        suction, swing = self._measured(cp, speed)
        driven = min(state.driven + 1, config.first_period)
        over = min(driven, config.mean_periods)
        after = replace(
            state,
            driven=driven,
            suction=state.suction + (suction - state.suction) / over,
            swing=state.swing + (swing - state.swing) / over,
        )
        if driven < config.first_period or state.rested == 0:
            return after
        helps = self._helps(after)
        after = replace(after, doubt=self._doubt(state.doubt, helps), spent=max(0, state.spent - helps))
        return after if after.doubt < config.doubt_periods else replace(after, tested_at=speed)

    def _tested(
        self, state: BenefitCheckState, cp: Array | None, speed: float
    ) -> tuple[BenefitCheckState, Reason | None]:
        """`next` in a test: what control was is compared with the wake since the jets were shut, of which more cycles
        count than of control: resumed by chance, control that hurts would begin anew."""
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
            after = replace(after, driven=0, suction=0.0, swing=0.0, doubt=0, tested_at=0.0)
        return after, Reason.NOT_HELPING if latches else None

    def _doubt(self, doubt: int, helps: bool) -> int:
        return max(0, doubt - 1) if helps else min(doubt + 1, self.config.doubt_periods)

    def _helps(self, state: BenefitCheckState) -> bool:
        config = self.config
        suction, swing = state.resting_suction, state.resting_swing
        if state.rested < self.proven:
            suction, swing = max(suction, 1.0), max(swing, 1.0)
        gained = suction - state.suction
        return gained >= config.least_gain * abs(suction) and state.swing <= config.most_swing * swing

    def _rested(self, state: BenefitCheckState, cp: Array, speed: float, over: int) -> BenefitCheckState:
        """Take this period into the means without control, which are over so many."""
        suction, swing = self._measured(cp, speed)
        return replace(
            state,
            resting_suction=state.resting_suction + (suction - state.resting_suction) / over,
            resting_swing=state.resting_swing + (swing - state.resting_swing) / over,
        )

    def _measured(self, cp: Array, speed: float) -> tuple[float, float]:
        """Suction on the base and mean magnitude of the differences, in units of the release's wake at this speed;
        summed one by one, as in C."""
        base = swing = 0.0
        for place in self.base:
            base += float(cp[place])
        for one, other in self.pairs:
            swing += abs(float(cp[one]) - float(cp[other]))
        resting_base, resting_swing = self._stated(speed)
        return base / len(self.base) / resting_base, swing / len(self.pairs) / resting_swing

    def _stated(self, speed: float) -> tuple[float, float]:
        """What base and swing of the release's wake are without jets at a speed, in Cp; linear in between."""
        before = self.resting[0]
        for after in self.resting:
            if speed < after[0]:
                share = (speed - before[0]) / (after[0] - before[0]) if after[0] > before[0] else 0.0
                return before[1] + share * (after[1] - before[1]), before[2] + share * (after[2] - before[2])
            before = after
        return before[1], before[2]


def resting_of(manifest: Manifest) -> tuple[tuple[float, float, float], ...]:
    """The wake without jets that a release states, by speed, as `BenefitCheck.resting` has it."""
    stated = manifest.resting
    return UNSTATED if stated is None else tuple(zip(stated.speeds, stated.base, stated.swing, strict=True))


def mirrored_pairs(manifest: Manifest) -> tuple[tuple[int, int], ...]:
    """Places of sensors and their mirror images among a release's; of unknown positions there are none."""
    positions = positions_of(manifest)
    if positions is None:
        return ()
    images = positions * [1.0, -1.0]
    places = combinations(range(len(positions)), 2)
    return tuple(pair for pair in places if np.abs(images[pair[0]] - positions[pair[1]]).max() <= SAME_PLACE)
