"""What of a release may be calibrated on a vehicle, how far, and the settings that follow from it.

The bounds on the jets can be narrowed, never widened: the vehicle's settings are their upper limits. The weights may be
any that make sense; the delay any that leaves the controller an action to choose.
"""

from dataclasses import replace
from typing import Final

from contract.config.controller import CostWeights
from contract.config.tree import Config
from contract.controller.calibration import LARGEST_WEIGHT, NAMES, WEIGHTS, Calibration, CalibrationLimits
from contract.release.bundle import Bundle

LEAST_SHARE: Final = 0.05
"""Of the vehicle's `flow.action_limit` and `ecu.command_step` that must be left: smaller ones are not a goal but a way
to switch the control off, which the enable request is for."""


def release_calibration(bundle: Bundle, config: Config, *, weights: CostWeights | None = None) -> Calibration:
    """The values that an ECU has without a calibration, in full precision.

    Args:
        bundle: verified release.
        config: of the vehicle.
        weights: of the cost, in place of the bundle's.
    """
    return Calibration(
        weights=bundle.manifest.mpc.weights if weights is None else weights,
        action_limit=config.flow.action_limit,
        command_step=config.ecu.command_step,
        delay_steps=config.ecu.delay_steps,
    )


def limits_of(bundle: Bundle, config: Config) -> CalibrationLimits:
    """Least and greatest values for a release in a vehicle, in full precision."""
    own = release_calibration(bundle, config)
    least = Calibration(
        weights=CostWeights(**dict.fromkeys(WEIGHTS, 0.0)),
        action_limit=LEAST_SHARE * own.action_limit,
        command_step=LEAST_SHARE * own.command_step,
        delay_steps=0,
    )
    greatest = Calibration(
        weights=CostWeights(
            **{name: max(LARGEST_WEIGHT, value) for name, value in zip(WEIGHTS, own.weights.as_tuple(), strict=True)}
        ),
        action_limit=own.action_limit,
        command_step=own.command_step,
        delay_steps=bundle.manifest.mpc.horizon - 1 - config.ecu.plan_ahead,
    )
    return CalibrationLimits(least=least, greatest=greatest)


def checked(calibration: Calibration, own: Calibration, limits: CalibrationLimits) -> Calibration:
    """A calibration within the limits, with the ECU's own value wherever rounding to float32 is all that differs.

    Args:
        calibration: as it comes over the bus, or in full precision.
        own: the ECU's values, in full precision.
        limits: compared as float32, so that the ECU's own values are within them however they are rounded.

    Raises:
        ConfigError: a value is out of the limits.
    """
    kept, own_kept = calibration.as_kept(), own.as_kept()
    CalibrationLimits(least=limits.least.as_kept(), greatest=limits.greatest.as_kept()).check(kept)
    values = {
        name: here if value == rounded else value
        for name, value, rounded, here in zip(NAMES, kept.values, own_kept.values, own.values, strict=True)
    }
    return Calibration(
        weights=CostWeights(**{name: values[name] for name in WEIGHTS}),
        action_limit=values["action_limit"],
        command_step=values["command_step"],
        delay_steps=kept.delay_steps,
    )


def with_calibration(config: Config, calibration: Calibration) -> Config:
    """The vehicle's settings with a calibration's bounds and delay; the weights are the release's, not a setting."""
    return replace(
        config,
        flow=replace(config.flow, action_limit=calibration.action_limit),
        ecu=replace(config.ecu, command_step=calibration.command_step, delay_steps=calibration.delay_steps),
    )
