"""Whether control helps: the pressure on the base under control against what it was before, with the jets shut.

A controller made for another speed, another body or another delay can raise drag, with every frame and every pressure
in order. Two means tell, both over two shedding cycles. Where control helps the base's suction falls; where it only
bends the wake aside, the pressures of mirrored sensors differ more than without control. What either was without
control is measured on the vehicle itself, whenever the jets have been shut for long enough. Since then the speed may
have changed, and the wake with it, so both means are of pressures as shares of what the release's own wake has at the
speed of each period.

Under control that does not help for a shedding cycle the jets are shut, and the fault latches. A new request for
control tries again.
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
from firmware_sim.ecu.fit import positions_of

ON_BASE: Final = "base_"
"""How the names of sensors on a body's base begin."""


@dataclass(frozen=True, kw_only=True)
class BenefitCheckState:
    """After a control period. Periods without pressures change no mean.

    Attributes:
        waking: periods with the jets shut until the wake is that without control; none at power-on.
        rested: periods that the means without control rest on, up to `ecu.benefit_check.mean_periods`.
        resting_base, resting_swing: the means without control, in Cp.
        driven: the same under control, up to `ecu.benefit_check.first_period`.
        base, swing: the means under control.
        doubt: periods in which control did not help less those in which it did.
    """

    waking: int = 0
    rested: int = 0
    resting_base: float = 0.0
    resting_swing: float = 0.0
    driven: int = 0
    base: float = 0.0
    swing: float = 0.0
    doubt: int = 0


@dataclass(frozen=True, kw_only=True)
class BenefitCheck:
    """The check of one release.

    Attributes:
        base: (B,) places of the sensors on the base among the release's.
        pairs: (P, 2) of mirrored sensors among them.
        resting: (K, 3) of `RestingWake.shares`.
    """

    base: tuple[int, ...]
    pairs: tuple[tuple[int, int], ...]
    config: BenefitCheckConfig
    resting: tuple[tuple[float, float, float], ...] = ((1.0, 1.0, 1.0),)

    @classmethod
    def of(cls, manifest: Manifest, config: BenefitCheckConfig) -> "BenefitCheck | None":
        """For a release; None where none of its sensors is on the base, or none has its mirror image."""
        base = tuple(place for place, name in enumerate(manifest.sensors) if name.startswith(ON_BASE))
        pairs = mirrored_pairs(manifest)
        if not (config.enabled and base and pairs):
            return None
        return cls(base=base, pairs=pairs, config=config, resting=resting_of(manifest))

    def next(
        self, state: BenefitCheckState, cp: Array | None, *, drives: bool, speed: float = 1.0
    ) -> tuple[BenefitCheckState, Reason | None]:
        """The state after a period, and why the ECU must switch itself off, if it must.

        Args:
            cp: (S,) this period's pressures; None without any.
            drives: whether the jets could run up to now.
            speed: of the vehicle, in design speeds.
        """
        config = self.config
        if not drives:
            waking = max(0, state.waking - 1)
            after = replace(state, waking=waking, driven=0, base=0.0, swing=0.0, doubt=0)
            return after if cp is None or waking else self._rested(after, cp, speed), None
        if cp is None:
            return replace(state, waking=config.wake_periods), None
        base, swing = self._measured(cp, speed)
        driven = min(state.driven + 1, config.first_period)
        over = min(driven, config.mean_periods)
        after = replace(
            state,
            waking=config.wake_periods,
            driven=driven,
            base=state.base + (base - state.base) / over,
            swing=state.swing + (swing - state.swing) / over,
        )
        if driven < config.first_period or state.rested == 0:
            return after, None
        doubt = state.doubt - 1 if self._helps(after) else state.doubt + 1
        doubt = min(max(0, doubt), config.doubt_periods)
        return replace(after, doubt=doubt), Reason.NOT_HELPING if doubt >= config.doubt_periods else None

    def _helps(self, state: BenefitCheckState) -> bool:
        config = self.config
        gained = state.base - state.resting_base
        return (
            gained >= config.least_gain * abs(state.resting_base)
            and state.swing <= config.most_swing * state.resting_swing
        )

    def _rested(self, state: BenefitCheckState, cp: Array, speed: float) -> BenefitCheckState:
        base, swing = self._measured(cp, speed)
        rested = min(state.rested + 1, self.config.mean_periods)
        return replace(
            state,
            rested=rested,
            resting_base=state.resting_base + (base - state.resting_base) / rested,
            resting_swing=state.resting_swing + (swing - state.resting_swing) / rested,
        )

    def _measured(self, cp: Array, speed: float) -> tuple[float, float]:
        """Mean pressure on the base and mean magnitude of the differences, as at the design speed; summed one by one,
        as in C."""
        base = swing = 0.0
        for place in self.base:
            base += float(cp[place])
        for one, other in self.pairs:
            swing += abs(float(cp[one]) - float(cp[other]))
        base_share, swing_share = self._shares(speed)
        return base / len(self.base) / base_share, swing / len(self.pairs) / swing_share

    def _shares(self, speed: float) -> tuple[float, float]:
        """What base and swing are without jets at a speed, as shares of the design speed's; linear in between."""
        before = self.resting[0]
        for after in self.resting:
            if speed < after[0]:
                share = (speed - before[0]) / (after[0] - before[0]) if after[0] > before[0] else 0.0
                return before[1] + share * (after[1] - before[1]), before[2] + share * (after[2] - before[2])
            before = after
        return before[1], before[2]


def resting_of(manifest: Manifest) -> tuple[tuple[float, float, float], ...]:
    """`RestingWake.shares` of a release; the same wake at all speeds where it states none."""
    shares = [[1.0, 1.0, 1.0]] if manifest.resting is None else manifest.resting.shares().tolist()
    return tuple((speed, base, swing) for speed, base, swing in shares)


def mirrored_pairs(manifest: Manifest) -> tuple[tuple[int, int], ...]:
    """Places of sensors and their mirror images among a release's; of unknown positions there are none."""
    positions = positions_of(manifest)
    if positions is None:
        return ()
    images = positions * [1.0, -1.0]
    places = combinations(range(len(positions)), 2)
    return tuple(pair for pair in places if np.abs(images[pair[0]] - positions[pair[1]]).max() <= SAME_PLACE)
