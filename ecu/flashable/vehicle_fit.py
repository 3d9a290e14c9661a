"""Whether a release is for this vehicle and runs on this computer, with the controller that it was tried with."""

from collections.abc import Callable

from can_bridge.flashing.verdicts import Verdict
from contract.config.tree import Config
from contract.controller.interface import Controller
from contract.errors import BundleControllerError, BundleError, ConfigError
from contract.release.checks import Bundle
from contract.runtime.onnx_estimator import OnnxEstimator
from ecu.fit import check_vehicle


class VehicleFit:
    """Judges bundles, and keeps the controller of the last one, so that a boot makes it once.

    Args:
        controller_of: makes a bundle's controller.
    """

    def __init__(self, config: Config, controller_of: Callable[[Bundle], Controller]) -> None:
        self._config, self._controller_of = config, controller_of
        self._made: tuple[str, Controller] | None = None

    def fits(self, bundle: Bundle) -> Verdict:
        """GOOD, or why it cannot run here."""
        flow = self._config.flow
        point = self._config.operating_point
        manifest = bundle.manifest
        if manifest.operating_point.period_ns(manifest.control_period) != point.period_ns(flow.control_period):
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
        """The one that the bundle was tried with, or a new one; raises BundleError if it does not run."""
        if self._made is None or self._made[0] != bundle.digest:
            self._made = None
            self._made = bundle.digest, self._controller_of(bundle)
        return self._made[1]
