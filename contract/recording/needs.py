"""The smallest numbers of control steps that an episode needs for training and for export, with reasons.

Windows do not cross an episode's boundary, so each episode must contain all steps that are read together.
"""

from dataclasses import dataclass
from typing import Final

from contract.config.tree import Config

HORIZONS: Final = (5, 10, 25)
"""Numbers of steps ahead at which open-loop prediction is tested. The horizon and the truck's cycle are 25 steps."""
STRETCH: Final = 64
"""Number of consecutive latent states that the distillation uses from one pass of the LSTM over a sequence of rows."""
GATE_WINDOWS: Final = 50
"""Number of consecutive recorded windows with which the export checks a controller."""
CALIBRATION_WINDOWS: Final = 400
"""Number of recorded windows with which int8 rounding is calibrated, in total over all kinds of forcing."""
LEAST_CALIBRATION: Final = 50
"""Smallest number of windows with which int8 rounding is calibrated: two shedding cycles of the truck. With fewer
windows, the measured ranges of the activations may be too small, so that values on the vehicle saturate."""
WINDOW_STEP: Final = 8
"""The window must be a multiple of this number of steps, so that the ECU in C can check the sensors."""


@dataclass(frozen=True, kw_only=True)
class Need:
    """The smallest number of control steps for a purpose, and the parts that add up to this number."""

    steps: int
    reason: str


def fitting_need(config: Config) -> Need:
    """Return the number of steps that an episode with role "train" needs."""
    window, train = config.model.window, config.train
    ahead = max(train.unroll, train.finish.unroll if train.finish.epochs else 0)
    reason = f"a window of {window}, {ahead} steps ahead and segments of {train.segment}"
    needs = [Need(steps=window - 1 + train.segment + ahead, reason=reason)]
    if train.stream_epochs:
        needs.append(Need(steps=window - 1 + STRETCH, reason=f"a window of {window} and sequences of {STRETCH}"))
    return max(needs, key=lambda need: need.steps)


def judging_need(config: Config) -> Need:
    """Return the number of steps that one episode with role "test" needs."""
    window, ahead = config.model.window, max(HORIZONS)
    return Need(steps=window + ahead, reason=f"a window of {window} and {ahead} steps ahead")


def window_for_c(steps: float) -> int:
    """Return the window length that is nearest to `steps` among the lengths that the ECU in C accepts."""
    return max(1, round(steps / WINDOW_STEP)) * WINDOW_STEP


def windows_in(steps: int, window: int) -> int:
    """Return the number of full windows in an episode of `steps` control steps."""
    return max(0, steps - window + 1)
