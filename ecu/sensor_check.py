"""The check of the sensors: each pressure is compared with its prediction from the other pressures.

A network of the bundle estimates each pressure from the window of the other pressures
(`contract.controller.estimator`). The residual is the pressure minus this estimate.
docs/explanation/what-shuts-the-jets.md lists the faults that the residuals can show, and the ECU's reactions.

Averages of the residuals over a few periods preserve slow changes and have less noise. These averages are squared,
and the squares are averaged over a shedding cycle. Noise, unlike a sensor fault, changes from one period to the next.
So the differences between consecutive residuals show how much noise remains in the averages, and the limits rise with
this noise. Noise on all sensors, which the controller tolerates, is therefore no fault.
"""

from dataclasses import dataclass, replace
from typing import Any, Final, Protocol

import numpy as np

from can_bridge.wire.messages import Reason
from contract.arrays import Array, ArrayValue
from contract.config.tree import Config
from contract.config.vehicle import SensorCheckConfig
from contract.controller.estimator import Hypotheses, pairs
from contract.controller.interface import ControllerError
from contract.release.checks import Bundle
from contract.release.manifest import FAST_PERIODS, SLOW_PERIODS, SensorEstimator
from contract.runtime.onnx_session import OnnxEstimator

SCORE_PERIODS: Final = 32
"""Number of periods over which the squares of averaged residuals are averaged: a shedding cycle. During a part of a
cycle, a wrong reading may agree with the other readings by chance."""
NOISE_ALLOWED: Final = 0.3
"""Share of the noise's variance that is added to the variance of healthy sensors. It is twice the share that remains in
the fast average, 1 / (2 * FAST_PERIODS - 1), because the estimate of the noise's variance is noisy, too."""
MOVING: Final = 0.4
"""A constant reading counts as stuck only if the median range of the other sensors is at least this number of standard
deviations of healthy residuals: 0.018 in Cp. In the shipped recording, the median over 10 periods is at least 0.029."""
ALIKE: Final = 0.1
"""One sensor may be a copy of another if the rms difference of their readings over a window is at most this number of
standard deviations of healthy sensors' residuals: 0.0045 in Cp. The difference of healthy sensors exceeds 0.011."""
COPIED: Final = 2.0
"""Smallest range (maximum minus minimum) of a sensor's readings in a window for which another sensor may be its copy,
in standard deviations of healthy sensors' residuals: 0.09 in Cp. Under control with the shipped release most ranges are
larger; the smallest is 0.075. In a calm wake, in which mirrored sensors agree, ranges are below 0.07."""
DRIFT_ALLOWED: Final = 4.0
"""Ratio of the limit for slow means of residuals (64) to the limit for fast means (16). The disagreement of healthy
sensors' slow means reaches 7, or 40 with one sensor left out."""
ASIDE_ALLOWED: Final = 2.0
"""Factor by which the permitted disagreement rises (to 32) when a sensor is set aside, since two sensors estimate less
accurately than three. Healthy sensors then disagree by up to 28, in a gust that the speed on the bus does not show."""


class EstimatorModel(Protocol):
    """A model that evaluates the estimator network of `sensors.onnx`, like `OnnxEstimator`."""

    def estimates(self, window: Array) -> Array:
        """Return the estimates in Cp, shape (V, S), for a window of shape (L, S + 1). Each of the V views of the window
        leaves out or exchanges sensors. Raises ControllerError if the model fails."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SensorCheckState(ArrayValue):
    """The state after a control period. The arrays are read-only. S is the number of sensors, P the number of pairs of
    sensors. An array without a stated shape has S + P rows, one for each of the `Hypotheses`, and S columns.

    Attributes:
        residual: residual in Cp of the latest period in which the sensors were judged; NaN before the first.
        fast, slow: running means of the residual over few and over many periods.
        noise: running variance of the residual's change from one period to the next, in Cp^2.
        score: running mean of a ratio: the square of `fast`, divided by its mean for healthy sensors with this noise.
        readings: (S,) latest readings; NaN before the first.
        flat: (S,) number of consecutive periods with unchanged readings.
        estimates: (n, S) estimate of each sensor by all others in the n periods of the controller's window or past.
        set_aside: index of the faulty sensor; None if there is none.
        doubt: number of periods in doubt minus the number of periods without doubt, at least 0.
        implausible: whether control must not use the pressures.
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
        """Return the state before any pressures are received."""
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
        """The sensor that is set aside, as a mask with one bit for each sensor, as in EcuStatus; 0 if there is none."""
        return 0 if self.set_aside is None else 1 << self.set_aside


@dataclass(frozen=True, kw_only=True, eq=False)
class SensorCheck:
    """The check of one bundle's pressures.

    Attributes:
        fast, slow: (S + P, S) rms in Cp of healthy sensors' mean residuals, for each hypothesis and sensor.
        sound: mean of the sensors' rms in `fast`; each sensor's rms is taken from the row that leaves this sensor out.
    """

    estimator: EstimatorModel
    fast: Array
    slow: Array
    sound: float
    config: SensorCheckConfig
    hypotheses: Hypotheses

    @classmethod
    def of(cls, figures: SensorEstimator, estimator: EstimatorModel, config: SensorCheckConfig) -> "SensorCheck":
        """Return the check that uses the rms values of a manifest, `figures`."""
        fast, slow = (_with_swaps(np.array(table)) for table in (figures.fast, figures.slow))
        sound, hypotheses = float(np.array(figures.fast).diagonal().mean()), Hypotheses.of(len(figures.fast))
        return cls(estimator=estimator, fast=fast, slow=slow, sound=sound, config=config, hypotheses=hypotheses)

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
        """Return the state after a period, and the reason why the ECU must switch itself off, or None.

        Args:
            window: (L, S + 1) the controller's window, with this period's row.
            rows: number of rows of the window that have data.
            cp: (S,) pressures of this period; None if there are none. No sensor is then judged.
            reading: (S,) pressures scaled with the design speed instead of the present speed; `cp` by default.
            skipped: number of skipped periods before the present period; the window has a row for each of them.
        """
        length = len(window)
        # The window has a new row for this period and each skipped period, so the estimates need equally many new rows.
        kept = state.estimates
        estimates = np.concatenate([kept, np.tile(kept[-1], (1 + min(skipped, len(kept)), 1))])[-len(kept) :]
        if cp is None or rows == 0:
            return replace(state, estimates=estimates), Reason.IMPLAUSIBLE if state.implausible else None
        seen = window
        if rows < length:
            # Until the window is full, its missing rows are filled with copies of its oldest row.
            seen = window.copy()
            seen[: length - rows] = window[length - rows]
        try:
            by_view = self.estimator.estimates(seen)
        except ControllerError:
            return replace(state, estimates=estimates), Reason.INTERNAL
        estimates[-1] = by_view[self.hypotheses.view.diagonal(), np.arange(len(cp))]
        reading = cp if reading is None else reading
        flat = np.where(reading == state.readings, state.flat + 1, 0.0)
        means = self._averaged(state, self.hypotheses.residuals(cp, by_view)) if rows == length else {}
        state = replace(state, readings=reading.copy(), flat=flat, estimates=estimates, **means)
        verdict = self._verdict(state, seen, full=rows == length)
        # Creating a state takes long, so it is done only if the verdict has changed.
        if any(getattr(state, name) != value for name, value in verdict.items()):
            state = replace(state, **verdict)
        return state, Reason.IMPLAUSIBLE if state.implausible else None

    def _evidence(self, state: SensorCheckState) -> tuple[Array, Array, float]:
        """Return three levels of evidence: that only one sensor reads wrongly, (S,), as a share of its limits for fast
        and slow means; that the two sensors of a pair are exchanged, (P,); and the disagreement of the sensors in use.
        They are mean squares of residuals relative to values of healthy sensors. The disagreement of slow means leaves
        out the sensor that is set aside, or else the sensor whose omission makes the others agree best."""
        config, sensors, aside = self.config, len(state.readings), state.set_aside
        slow = np.square(state.slow) / (np.square(self.slow) + state.noise / (2 * SLOW_PERIODS - 1))
        (alone, others), (slow_alone, slow_others) = _split(state.score, sensors), _split(slow, sensors)
        doubt = alone.mean() if aside is None else others[aside] / ASIDE_ALLOWED
        drift = slow_others.min() if aside is None else slow_others[aside]
        liar, bias = alone / (1.0 + others), slow_alone / (1.0 + slow_others)
        swap = alone.mean() / (1.0 + state.score[sensors:].mean(axis=1))
        alone_wrong = np.maximum(liar / config.liar_level, bias / config.bias_level)
        return alone_wrong, swap, max(float(doubt), float(drift) / DRIFT_ALLOWED)

    def _averaged(self, state: SensorCheckState, residual: Array) -> dict[str, Any]:
        before = np.where(np.isnan(state.residual), residual, state.residual)
        fast = _mean(state.fast, residual, FAST_PERIODS)
        noise = _mean(state.noise, np.square(residual - before) / 2.0, SCORE_PERIODS)
        score = _mean(state.score, np.square(fast) / (np.square(self.fast) + NOISE_ALLOWED * noise), SCORE_PERIODS)
        slow = _mean(state.slow, residual, SLOW_PERIODS)
        return {"residual": residual, "fast": fast, "slow": slow, "noise": noise, "score": score}

    def _others_move(self, resting: int, window: Array) -> bool:
        """Return whether the other sensors' readings varied, as in a flow, while `resting` had a constant reading."""
        moved = np.ptp(window[-self.config.flat_periods :, :-1], axis=0)
        return bool(np.median(np.delete(moved, resting)) >= MOVING * self.sound)

    def _any_alike(self, window: Array, set_aside: int | None) -> bool:
        """Return whether two sensors in use have nearly equal readings over a window in which the readings vary."""
        one, other = np.transpose([pair for pair in pairs(window.shape[1] - 1) if set_aside not in pair])
        # `cumsum` adds in a fixed order, as C does; `sum` may add in another order.
        squares = np.square(window[:, one] - window[:, other]).cumsum(axis=0)
        same = squares[-1] <= len(window) * (ALIKE * self.sound) ** 2
        return bool((same & (np.ptp(window[:, one], axis=0) >= COPIED * self.sound)).any())

    def _verdict(self, state: SensorCheckState, window: Array, *, full: bool) -> dict[str, Any]:
        """Return new values of `set_aside`, `doubt` and `implausible`; `full` states that the window is full."""
        config, (alone_wrong, swap, disagreement) = self.config, self._evidence(state)
        flat = np.flatnonzero(state.flat >= config.flat_periods)
        others_flat = [j for j in flat if j != state.set_aside]
        set_aside = state.set_aside
        if set_aside is None and len(others_flat) == 1 and self._others_move(int(others_flat[0]), window):
            set_aside, others_flat = int(others_flat[0]), []
        elif set_aside is None and alone_wrong.max() >= 1.0:
            set_aside = int(alone_wrong.argmax())
        newly = set_aside != state.set_aside
        doubted = disagreement >= config.doubt_level or (set_aside is None and swap.max() >= config.swap_level)
        if others_flat or (full and self._any_alike(window, set_aside)):
            doubt = config.doubt_periods
        elif newly:
            doubt = 0
        else:
            doubt = min(config.doubt_periods, max(0, state.doubt + (1 if doubted else -1)))
        implausible = doubt >= config.doubt_periods or (state.implausible and doubt > 0)
        return {"set_aside": set_aside, "doubt": doubt, "implausible": implausible}


def sensor_check_of(bundle: Bundle, config: Config) -> SensorCheck | None:
    """Return a bundle's sensor check; None if the bundle has no estimator or the settings disable the check."""
    figures, wanted = bundle.manifest.sensor_estimator, config.ecu.sensor_check
    estimator = OnnxEstimator.of(bundle) if wanted.enabled else None
    return None if figures is None or estimator is None else SensorCheck.of(figures, estimator, wanted)


def _split(values: Array, sensors: int) -> tuple[Array, Array]:
    """Return for each sensor its value in the row that leaves it out, and the mean of that row's other values."""
    own = values[:sensors].diagonal()
    return own, (values[:sensors].sum(axis=1) - own) / (sensors - 1)


def _with_swaps(table: Array) -> Array:
    """Append the diagonal (each sensor estimated by all others) once for each of the P pairs; returns (S + P, S)."""
    return np.concatenate([table, np.tile(table.diagonal(), (len(pairs(len(table))), 1))])


def _mean(before: Array, value: Array, periods: int) -> Array:
    return before + (value - before) / periods
