"""How many control steps an episode must have for training and export, and why.

Windows do not cross an episode's boundary, so each episode must hold what is read at once.
"""

from dataclasses import dataclass
from typing import Final

from contract.config.learning import TrainConfig
from contract.config.tree import Config

HORIZONS: Final = (5, 10, 25)
"""Control steps ahead at which open-loop prediction is judged; 25 is one shedding cycle of the truck, the MPC's
horizon."""

STRETCH: Final = 64
"""Latents that the distillation learns from in one pass over a stretch of the recording."""

GATE_WINDOWS: Final = 50
"""Consecutive recorded windows that the export gates replay."""

CALIBRATION_WINDOWS: Final = 400
"""Recorded windows from which int8 rounding is calibrated, of every kind of forcing together."""

LEAST_CALIBRATION: Final = 50
"""The least number of windows. Fewer let the ranges of the activations rest on less than a shedding cycle or two: 50
steps are two of the truck's. A value beyond a calibrated range saturates on the vehicle."""

WINDOW_STEP: Final = 8
"""The sensor check of the ECU in C takes windows of whole multiples of so many steps."""


@dataclass(frozen=True, kw_only=True)
class Need:
    """A least number of control steps and what it is made of, in words."""

    steps: int
    reason: str


def fitting_need(config: Config) -> Need:
    """Steps of an episode with role "train"."""
    window, train = config.model.window, config.train
    needs = [_of_fit(window, train, train.unroll)]
    if train.finish.epochs:
        needs.append(_of_fit(window, train, train.finish.unroll))
    if train.stream_epochs:
        needs.append(Need(steps=window - 1 + STRETCH, reason=f"a window of {window} and stretches of {STRETCH}"))
    return max(needs, key=lambda need: need.steps)


def judging_need(config: Config) -> Need:
    """Steps of one episode with role "test": the longest roll-out by which the model is judged."""
    window, ahead = config.model.window, max(HORIZONS)
    return Need(steps=window + ahead, reason=f"a window of {window} and {ahead} steps ahead")


def roll_out_need(config: Config) -> Need | None:
    """Steps of one episode with role "train", if narrower dynamics and decoder are distilled on roll-outs."""
    if not config.model.is_slimmed:
        return None
    window, horizon = config.model.window, config.mpc.horizon
    return Need(steps=window + horizon, reason=f"a window of {window} and the horizon of {horizon} steps")


def gate_need(config: Config) -> Need:
    """Steps of the first episode with role "test": the export's gates replay it."""
    window = config.model.window
    return Need(steps=window - 1 + GATE_WINDOWS, reason=f"{GATE_WINDOWS} windows of {window} for the export's gates")


def calibration_need(config: Config) -> Need:
    """Steps of the episodes with role "train" that int8 is calibrated on, one of each kind of forcing."""
    window = config.model.window
    return Need(
        steps=window - 1 + LEAST_CALIBRATION,
        reason=f"{LEAST_CALIBRATION} windows of {window} to calibrate int8",
    )


def window_for_c(steps: float) -> int:
    """The window nearest to so many steps that the ECU in C takes."""
    return max(1, round(steps / WINDOW_STEP)) * WINDOW_STEP


def windows_in(steps: int, window: int) -> int:
    """Full windows of an episode of so many steps."""
    return max(0, steps - window + 1)


def _of_fit(window: int, train: TrainConfig, unroll: int) -> Need:
    return Need(
        steps=window - 1 + train.segment + unroll,
        reason=f"a window of {window}, {unroll} steps ahead and segments of {train.segment}",
    )
