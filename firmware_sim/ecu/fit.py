"""Whether a release was made for this flow and this vehicle; a refusal names both values."""

from can_bridge.wire.messages import SENSORS
from contract.config.plant import FlowConfig
from contract.config.tree import Config
from contract.errors import BundleError
from contract.release.bundle import Bundle


def check_flow(bundle: Bundle, flow: FlowConfig) -> None:
    """Raises BundleError if the controller was built for another control period or action limit."""
    _check_flow(bundle, flow, owner="flow")


def check_vehicle(bundle: Bundle, config: Config) -> None:
    """Raises BundleError if the controller was built for another vehicle, bus or actuator delay."""
    manifest = bundle.manifest
    _check_equal(bundle, "operating point", manifest.operating_point, config.operating_point, owner="vehicle")
    _check_flow(bundle, config.flow, owner="vehicle")
    if len(manifest.sensors) != SENSORS:
        raise BundleError(
            f"bundle {manifest.name!r} has {len(manifest.sensors)} sensors: the Pressure message carries {SENSORS}"
        )
    if config.ecu.delay_steps >= manifest.mpc.horizon:
        raise BundleError(
            f"ecu.delay_steps = {config.ecu.delay_steps}: must be below the horizon {manifest.mpc.horizon}"
        )


def _check_flow(bundle: Bundle, flow: FlowConfig, *, owner: str) -> None:
    manifest = bundle.manifest
    _check_equal(bundle, "control period", manifest.control_period, flow.control_period, owner=owner)
    _check_equal(bundle, "action limit", manifest.action_limit, flow.action_limit, owner=owner)


def _check_equal(bundle: Bundle, name: str, built_for: object, here: object, *, owner: str) -> None:
    if built_for != here:
        raise BundleError(
            f"bundle {bundle.manifest.name!r} was built for another {name}: {built_for}, the {owner} has {here}"
        )
