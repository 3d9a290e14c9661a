"""The values of a release that may be calibrated on a vehicle, their limits, and the settings that result.

The bounds on the jets can be narrowed, never widened: the vehicle's settings are their upper limits. The weights of the
cost may have any value from 0 to their largest valid value. The assumed delay of the actuator is limited so that the
controller always has an action to choose.
"""

from dataclasses import replace
from typing import Final

import numpy as np

from contract.config.controller import CostWeights
from contract.config.tree import Config
from contract.controller.calibration import LARGEST_WEIGHT, Calibration, CalibrationLimits, as_float32
from contract.controller.interface import TERMS
from contract.release.checks import Bundle

LEAST_SHARE: Final = 0.05
"""Smallest calibrated `flow.action_limit` and `ecu.command_step`, as a share of the vehicle's own values."""


def release_calibration(bundle: Bundle, config: Config) -> Calibration:
    """Return the values at power-on: a verified release's cost weights, and the vehicle's bounds and delay."""
    limit, ecu = config.flow.action_limit, config.ecu
    weights, step, delay = bundle.manifest.mpc.weights, ecu.command_step, ecu.delay_steps
    return Calibration(weights=weights, action_limit=limit, command_step=step, delay_steps=delay)


def limits_of(bundle: Bundle, config: Config) -> CalibrationLimits:
    """Return the smallest and the largest values to which a release may be calibrated in a vehicle."""
    own = release_calibration(bundle, config)
    lightest = CostWeights(**dict.fromkeys(TERMS, 0.0))
    limit, step = LEAST_SHARE * own.action_limit, LEAST_SHARE * own.command_step
    least = Calibration(weights=lightest, action_limit=limit, command_step=step, delay_steps=0)
    heaviest = CostWeights(**{name: max(LARGEST_WEIGHT, value) for name, value in vars(own.weights).items()})
    longest = bundle.manifest.mpc.horizon - 1 - config.ecu.plan_ahead
    return CalibrationLimits(least=least, greatest=replace(own, weights=heaviest, delay_steps=longest))


def with_calibration(config: Config, calibration: Calibration) -> Config:
    """Return the vehicle's settings with the jets' bounds and the actuator's delay from a calibration. A bound is
    rounded to float32, as in C. But if the rounded bound equals the vehicle's rounded setting, the setting itself is
    used, so that a calibration to the vehicle's own values changes no bit of the results."""

    def bound(value: float, own: float) -> float:
        return own if value == as_float32(own) else float(np.float32(value))

    limit = bound(calibration.action_limit, config.flow.action_limit)
    step = bound(calibration.command_step, config.ecu.command_step)
    ecu = replace(config.ecu, command_step=step, delay_steps=calibration.delay_steps)
    return replace(config, flow=replace(config.flow, action_limit=limit), ecu=ecu)
