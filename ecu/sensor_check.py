"""Whether the pressures are to be believed: each is compared with what the others predict for it.

Transducers fail without a sign: they stand still, read zero, move away, or are plugged in the wrong way round, and all
frames are in order. A network of the bundle estimates each pressure from the window of the others
(`contract.controller.estimator`), and three hypotheses are judged by the residuals:

* one sensor lies: it is far from the estimate by the others, and these agree with each other without it. It is set
  aside until the ECU is restarted, and its estimate, which is never built on itself, stands in for it;
* two are exchanged: with their readings put right, all agree far better. The jets go to zero, and the fault latches;
* the pressures disagree, at once or in the mean of two shedding cycles, and neither explains it. The same.

Residuals are averaged over a few periods, which keeps what is slow and drops noise, squared, and averaged again over a
shedding cycle. Noise changes from one period to the next, as no lie does: what noise is left is measured by the
residuals' differences, and allowed for. So noise on all sensors, which the controller bears, never takes control away.

Sensors that read the same over a whole window, and move, are copies of one, as a broken multiplexer makes them: the
jets go to zero. Mirror images that hardly move are none: a calm wake is symmetric. A reading that never changes at all
is stuck: no transducer in a flow does that. Whether there is a flow, by the others: on a vehicle that stands or creeps,
all pressures rest or nearly so, and none of them lies.
"""

from dataclasses import dataclass, field, replace
from typing import Any, Final, NamedTuple, Protocol

import numpy as np

from can_bridge.wire.messages import Reason
from contract.arrays import Array, ArrayValue
from contract.config.tree import Config
from contract.config.vehicle import SensorCheckConfig
from contract.controller.estimator import Hypotheses, pairs
from contract.controller.interface import ControllerError
from contract.release.checks import Bundle
from contract.release.manifest import FAST_PERIODS, SLOW_PERIODS, SensorEstimator
from contract.runtime.onnx_estimator import OnnxEstimator

SCORE_PERIODS: Final = 32
"""Over which squares are averaged: a shedding cycle, since a lie may agree with the flow for part of one."""
NOISE_ALLOWED: Final = 0.3
"""Share of the variance of noise: twice what the fast average leaves of it, 1 / (2 FAST_PERIODS - 1), since the
estimate has some as well."""

MOVING: Final = 0.4
"""Deviations of sound sensors' residuals by which the others have to move while one rests, or it is no lie. In the
shipped recording it is 0.015 in Cp; the others' median moves by 0.022 or more in any ten periods."""

ALIKE: Final = 0.1
"""The same for copies: the rms difference of two readings over a window. 0.004 in Cp; sound ones have over 0.011."""

COPIED: Final = 2.0
"""Such deviations by which a reading moves over the window in which another is its copy: 0.08 in Cp. Under control of
the shipped release all move by over 0.11; on the calm wake, where mirror images are alike, by less than 0.07."""

DRIFT_ALLOWED: Final = 4.0
"""How much more slow means may disagree than fast ones: 64; sound ones reach 7, or 40 without any one sensor."""

ASIDE_ALLOWED: Final = 2.0
"""How much more the sensors that are left may disagree when one is set aside: two others tell less of each than three.
Sound ones reach 28 then, in a gust that the speed on the bus does not show."""


class EstimatorModel(Protocol):
    """What computes `sensors.onnx`."""

    def estimates(self, window: Array) -> Array:
        """(V, S) in Cp for a window (L, S+1); raises ControllerError if there are none."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SensorCheckState(ArrayValue):
    """The state after a control period. The arrays have a row a hypothesis, S + P of them (`Hypotheses`), and are
    read-only.

    Attributes:
        residual: of the latest judged period, in Cp; NaN before the first.
        fast, slow: its running means.
        noise: running variance of what changes from one period to the next, in Cp^2.
        score: running mean of the fast mean's square, less the noise, in variances of sound sensors.
        readings: (S,) the latest; NaN before the first.
        flat: (S,) periods in a row in which they were the same before.
        estimates: (n, S) of each sensor by all the others, a row for each of the latest periods: as many as the
            controller's window has rows, or its past.
        set_aside: the sensor that lies; None without one.
        doubt: periods in doubt less those out of it.
        implausible: control must not rest on the pressures.
    """

    residual: Array
    fast: Array
    slow: Array
    noise: Array
    score: Array
    readings: Array
    flat: Array
    estimates: Array
    set_aside: int | None = None
    doubt: int = 0
    implausible: bool = False

    @classmethod
    def start(cls, *, window: int, sensors: int) -> "SensorCheckState":
        """Nothing received."""
        shape = (sensors + len(pairs(sensors)), sensors)
        zeros = np.zeros(shape)
        return cls(
            residual=np.full(shape, np.nan),
            fast=zeros,
            slow=zeros,
            noise=zeros,
            score=zeros,
            readings=np.full(sensors, np.nan),
            flat=np.zeros(sensors),
            estimates=np.zeros((window, sensors)),
        )

    @property
    def mask(self) -> int:
        """Sensors set aside, a bit each, as EcuStatus reports them."""
        return 0 if self.set_aside is None else 1 << self.set_aside


class ResidualLevels(NamedTuple):
    """Residuals of one period, as ratios to what sound sensors show.

    Attributes:
        liar: (S,) that this sensor lies, and the others do not.
        bias: (S,) the same, of the slow means.
        swap: (P,) that these two are exchanged.
        doubt: that the sensors which are in use disagree, half as much with one set aside (`ASIDE_ALLOWED`).
        drift: the same, of the slow means, whichever one of all sensors is left out, over `DRIFT_ALLOWED`.
    """

    liar: Array
    bias: Array
    swap: Array
    doubt: float
    drift: float


@dataclass(frozen=True, kw_only=True, eq=False)
class SensorCheck:
    """The check of one bundle's pressures. `fast` and `slow` are (S + P, S) deviations of sound sensors' residuals in
    Cp."""

    estimator: EstimatorModel
    fast: Array
    slow: Array
    config: SensorCheckConfig
    hypotheses: Hypotheses = field(init=False)
    _sound: float = field(init=False)

    def __post_init__(self) -> None:
        sensors = self.fast.shape[1]
        object.__setattr__(self, "hypotheses", Hypotheses.of(sensors))
        object.__setattr__(self, "_sound", float(self.fast[:sensors].diagonal().mean()))

    @classmethod
    def of(cls, figures: SensorEstimator, estimator: EstimatorModel, config: SensorCheckConfig) -> "SensorCheck":
        """The check with a manifest's figures."""
        fast, slow = (_with_swaps(np.array(table)) for table in (figures.fast, figures.slow))
        return cls(estimator=estimator, fast=fast, slow=slow, config=config)

    def next(
        self,
        state: SensorCheckState,
        window: Array,
        rows: int,
        cp: Array | None,
        *,
        reading: Array | None = None,
        skipped: int = 0,
    ) -> tuple[SensorCheckState, Reason | None]:
        """The state after a period, and why the ECU must switch itself off, if it must.

        Args:
            window: (L, S + 1) the controller's, with this period's row.
            rows: how many of them have come.
            cp: this period's pressures, (S,); None without any: nothing is judged.
            reading: the same as they came, whatever the speed is; `cp` without.
            skipped: periods without a step before this one, for each of which the window has a row as well.
        """
        length, kept_rows = len(window), len(state.estimates)
        if cp is None or rows == 0:
            held = _appended(state.estimates, state.estimates[-1], 1 + min(skipped, kept_rows))
            kept = replace(state, estimates=held)
            return kept, Reason.IMPLAUSIBLE if kept.implausible else None
        seen = window
        if rows < length:
            # As after an ECU's start: what was before the first row is taken to have been like it.
            seen = window.copy()
            seen[: length - rows] = window[length - rows]
        try:
            by_view = self.estimator.estimates(seen)
        except ControllerError:
            # The window goes on, and its companions with it.
            held = _appended(state.estimates, state.estimates[-1], 1 + min(skipped, kept_rows))
            return replace(state, estimates=held), Reason.INTERNAL
        estimates = _appended(state.estimates, state.estimates[-1], min(skipped, kept_rows))
        own = by_view[self.hypotheses.view.diagonal(), np.arange(len(cp))]
        estimates = _appended(estimates, own, 1)
        reading = cp if reading is None else reading
        flat = np.where(reading == state.readings, state.flat + 1, 0.0)
        means = self._averaged(state, self.hypotheses.residuals(cp, by_view)) if rows == length else {}
        state = replace(state, readings=reading.copy(), flat=flat, estimates=estimates, **means)
        verdict = self._verdict(state, seen, full=rows == length)
        # As a rule it stands, and a state is costly to make.
        if any(getattr(state, name) != value for name, value in verdict.items()):
            state = replace(state, **verdict)
        return state, Reason.IMPLAUSIBLE if state.implausible else None

    def levels(self, state: SensorCheckState) -> ResidualLevels:
        """The verdict of the running means of a state."""
        sensors = len(state.readings)
        slow = np.square(state.slow) / (np.square(self.slow) + state.noise / (2 * SLOW_PERIODS - 1))
        fast_each, slow_each = _split(state.score, sensors), _split(slow, sensors)
        swapped = state.score[sensors:].mean(axis=1)
        alone = fast_each.own
        aside = state.set_aside
        doubt = alone.mean() if aside is None else fast_each.others[aside] / ASIDE_ALLOWED
        drift = slow_each.others.min() if aside is None else slow_each.others[aside]
        return ResidualLevels(
            liar=alone / (1.0 + fast_each.others),
            bias=slow_each.own / (1.0 + slow_each.others),
            swap=alone.mean() / (1.0 + swapped),
            doubt=float(doubt),
            drift=float(drift) / DRIFT_ALLOWED,
        )

    def _averaged(self, state: SensorCheckState, residual: Array) -> dict[str, Any]:
        """The state's running means after one more residual."""
        before = np.where(np.isnan(state.residual), residual, state.residual)
        fast = _mean(state.fast, residual, FAST_PERIODS)
        noise = _mean(state.noise, np.square(residual - before) / 2.0, SCORE_PERIODS)
        score = np.square(fast) / (np.square(self.fast) + NOISE_ALLOWED * noise)
        return {
            "residual": residual,
            "fast": fast,
            "slow": _mean(state.slow, residual, SLOW_PERIODS),
            "noise": noise,
            "score": _mean(state.score, score, SCORE_PERIODS),
        }

    def _others_move(self, resting: int, window: Array) -> bool:
        """Whether the other pressures of a window show a flow in the periods in which this one rested."""
        moved = np.ptp(window[-self.config.flat_periods :, :-1], axis=0)
        return bool(np.median(np.delete(moved, resting)) >= MOVING * self._sound)

    def _any_alike(self, window: Array, set_aside: int | None) -> bool:
        """Whether two sensors in use have the same reading over a window, and it moves."""
        one, other = np.transpose([pair for pair in pairs(window.shape[1] - 1) if set_aside not in pair])
        # One after the other, as in C: `sum` may add in another order.
        squares = np.square(window[:, one] - window[:, other]).cumsum(axis=0)
        same = squares[-1] <= len(window) * (ALIKE * self._sound) ** 2
        return bool((same & (np.ptp(window[:, one], axis=0) >= COPIED * self._sound)).any())

    def _verdict(self, state: SensorCheckState, window: Array, *, full: bool) -> dict[str, Any]:
        """What means, resting readings and the window (L, S + 1) amount to, by the names of the state's fields."""
        config, levels = self.config, self.levels(state)
        flat = np.flatnonzero(state.flat >= config.flat_periods)
        others_flat = [j for j in flat if j != state.set_aside]
        set_aside = state.set_aside
        if set_aside is None and len(others_flat) == 1 and self._others_move(int(others_flat[0]), window):
            set_aside, others_flat = int(others_flat[0]), []
        elif set_aside is None:
            evidence = np.maximum(levels.liar / config.liar_level, levels.bias / config.bias_level)
            if evidence.max() >= 1.0:
                set_aside = int(evidence.argmax())
        newly = set_aside != state.set_aside
        doubted = max(levels.doubt, levels.drift) >= config.doubt_level
        if set_aside is None:
            doubted = doubted or bool(levels.swap.max() >= config.swap_level)
        if others_flat or (full and self._any_alike(window, set_aside)):
            doubt = config.doubt_periods
        elif newly:
            doubt = 0
        else:
            doubt = min(config.doubt_periods, max(0, state.doubt + (1 if doubted else -1)))
        implausible = doubt >= config.doubt_periods or (state.implausible and doubt > 0)
        return {"set_aside": set_aside, "doubt": doubt, "implausible": implausible}


def sensor_check_of(bundle: Bundle, config: Config) -> SensorCheck | None:
    """The check of a bundle's pressures; None if it has no estimator, or the settings want none."""
    figures, wanted = bundle.manifest.sensor_estimator, config.ecu.sensor_check
    estimator = OnnxEstimator.of(bundle) if wanted.enabled else None
    return None if figures is None or estimator is None else SensorCheck.of(figures, estimator, wanted)


class _Split(NamedTuple):
    """Split an array (S + P, S): each sensor by all others, (S,), and the mean of the others without it, (S,)."""

    own: Array
    others: Array


def _split(values: Array, sensors: int) -> _Split:
    own = values[:sensors].diagonal()
    return _Split(own=own, others=(values[:sensors].sum(axis=1) - own) / (sensors - 1))


def _with_swaps(table: Array) -> Array:
    """(S + P, S): with two exchanged, each is estimated by all others, as in the diagonal."""
    sensors = len(table)
    return np.concatenate([table, np.tile(table.diagonal(), (len(pairs(sensors)), 1))])


def _mean(before: Array, value: Array, periods: int) -> Array:
    """The running mean after one more value."""
    return before + (value - before) / periods


def _appended(rows: Array, row: Array, times: int) -> Array:
    """The newest of the rows with one more, so many times; as many as before."""
    return np.concatenate([rows, np.tile(row, (times, 1))])[-len(rows) :]
