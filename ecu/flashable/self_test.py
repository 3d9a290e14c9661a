"""Whether the release that runs computes: before it is confirmed, and on what a vehicle may bring.

Everything was verified before; this shows that the controller and the estimator run on this very computer.
"""

from collections.abc import Iterator
from typing import Final

import numpy as np

from can_bridge.flashing.backing import Long
from contract.arrays import Array
from contract.controller.interface import Controller, ControllerError, Sizes
from contract.release.checks import Bundle
from contract.runtime.onnx_estimator import OnnxEstimator

AMPLITUDE_CP: Final = 0.3
"""Amplitude of the made-up pressures: what a shedding wake brings at the rear edges."""
SHEDDING_CYCLE_TC: Final = 5.0
LIMIT_SLACK: Final = 1e-5
"""By which a plan in float32 may exceed the action limit."""


def self_test(bundle: Bundle, controller: Controller) -> Long[None]:
    """Run the controller on windows of zeros and of a shedding wake, and the estimator on the same, piece by piece.
    Raises ControllerError if one of them fails, or an answer is not finite, of another shape, or beyond the action
    limit."""
    sizes = bundle.manifest.sizes
    weights = np.array(bundle.manifest.mpc.weights.as_tuple())
    estimator = OnnxEstimator.of(bundle)
    yield
    for window in _windows(sizes, bundle.manifest.control_period):
        answer = controller.control_step(window, np.zeros(sizes.horizon), np.ones(sizes.horizon), weights)
        plan, forces = np.asarray(answer.plan), np.asarray(answer.forces)
        if plan.shape != (sizes.horizon,) or not (np.isfinite(plan).all() and np.isfinite(forces).all()):
            raise ControllerError(f"self-test: a plan of shape {plan.shape} must be ({sizes.horizon},), and finite")
        if (largest := float(np.abs(plan).max())) > bundle.manifest.action_limit + LIMIT_SLACK:
            raise ControllerError(
                f"self-test: a plan of {largest:g}: must be within the action limit of {bundle.manifest.action_limit:g}"
            )
        yield
        if estimator is not None:
            estimator.estimates(window)
            yield


def _windows(sizes: Sizes, control_period: float) -> Iterator[Array]:
    """(L, S + 1) each."""
    yield np.zeros((sizes.window, sizes.sensors + 1))
    phase = 2 * np.pi * control_period / SHEDDING_CYCLE_TC * np.arange(sizes.window)
    shifts = np.pi * np.arange(sizes.sensors)
    cp = AMPLITUDE_CP * np.sin(phase[:, None] + shifts)
    yield np.column_stack([cp, np.zeros(sizes.window)])
