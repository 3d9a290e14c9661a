"""The check of a release before each boot and confirmation: it must be for this vehicle and run on this computer.

All other checks of the release are done before this one. The self-test shows that controller and estimator run.
"""

from collections.abc import Callable, Iterator
from typing import Final

import numpy as np

from can_bridge.flashing.backing import Long
from can_bridge.flashing.verdicts import Verdict
from contract.arrays import Array
from contract.config.tree import Config
from contract.controller.interface import Controller, ControllerError, Sizes
from contract.errors import BundleControllerError, BundleError, ConfigError
from contract.release.checks import Bundle
from contract.runtime.onnx_session import OnnxEstimator
from ecu.fit import check_vehicle


class VehicleFit:
    """The check of bundles. It stores the latest bundle's controller, which a boot of this bundle then uses."""

    def __init__(self, config: Config, controller_of: Callable[[Bundle], Controller]) -> None:
        self._config, self._controller_of = config, controller_of
        self._made: tuple[str, Controller] | None = None

    def fits(self, bundle: Bundle) -> Verdict:
        """Return GOOD, or the reason why the bundle cannot run here."""
        manifest = bundle.manifest
        if manifest.operating_point.period_ns(manifest.control_period) != self._config.period_ns:
            return Verdict.WRONG_PERIOD
        try:
            check_vehicle(bundle, self._config)
        except (BundleError, ConfigError):
            return Verdict.WRONG_VEHICLE
        try:
            self.controller(bundle)
            OnnxEstimator.of(bundle)
        except BundleControllerError:
            return Verdict.DAMAGED
        return Verdict.GOOD

    def controller(self, bundle: Bundle) -> Controller:
        """Return the controller that the check has created, or a new one; raise BundleError if it does not run."""
        if self._made is None or self._made[0] != bundle.digest:
            self._made = None
            self._made = bundle.digest, self._controller_of(bundle)
        return self._made[1]


AMPLITUDE_CP: Final = 0.3
"""Amplitude of the synthetic pressures, in Cp: a typical value of a shedding wake at the rear edges."""
SHEDDING_CYCLE_TC: Final = 5.0
LIMIT_SLACK: Final = 1e-5
"""Amount in U_inf W by which a plan in float32 may exceed the action limit."""


def self_test(bundle: Bundle, controller: Controller) -> Long[None]:
    """Run controller and estimator, in parts, on a window of zeros and a shedding wake's window. Raises ControllerError
    if a run fails, a plan or a force is not finite, or a plan has a wrong shape or exceeds the action limit."""
    sizes, limit = bundle.manifest.sizes, bundle.manifest.action_limit
    weights, estimator = np.array(bundle.manifest.mpc.weights.as_tuple()), OnnxEstimator.of(bundle)
    yield
    for window in _windows(sizes, bundle.manifest.control_period):
        answer = controller.control_step(window, np.zeros(sizes.horizon), np.ones(sizes.horizon), weights)
        plan, forces = np.asarray(answer.plan), np.asarray(answer.forces)
        if plan.shape != (sizes.horizon,):
            raise ControllerError(f"self-test: a plan has shape {plan.shape}: must have shape ({sizes.horizon},)")
        if not (np.isfinite(plan).all() and np.isfinite(forces).all()):
            raise ControllerError("self-test: a plan or a predicted force is not finite")
        if (largest := float(np.abs(plan).max())) > limit + LIMIT_SLACK:
            raise ControllerError(f"self-test: a plan reaches {largest:g}: the action limit is {limit:g}")
        yield
        if estimator is not None:
            estimator.estimates(window)
            yield


def _windows(sizes: Sizes, control_period: float) -> Iterator[Array]:
    """Yield the windows for the self-test, each of the shape (L, S + 1) for L rows and S sensors."""
    yield np.zeros((sizes.window, sizes.sensors + 1))
    phase = 2 * np.pi * control_period / SHEDDING_CYCLE_TC * np.arange(sizes.window)
    shifts = np.pi * np.arange(sizes.sensors)
    cp = AMPLITUDE_CP * np.sin(phase[:, None] + shifts)
    yield np.column_stack([cp, np.zeros(sizes.window)])
