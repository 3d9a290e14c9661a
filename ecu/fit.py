"""The checks that a release was made for this flow and vehicle. An error states the required and the present value."""

from dataclasses import fields

import numpy as np

from can_bridge.wire.messages import SENSORS
from contract.arrays import Array
from contract.config.plant import FlowConfig
from contract.config.tree import Config
from contract.config.vehicle import EcuConfig
from contract.errors import BundleError, ConfigError
from contract.release.checks import Bundle
from contract.release.manifest import Manifest
from contract.sensor_layout import SAME_PLACE, SensorLayout
from contract.sensors import TRUCK


def check_flow(bundle: Bundle, flow: FlowConfig, *, owner: str = "flow") -> None:
    """Raise BundleError if the controller was built for a control period or action limit that differs from `flow`."""
    for name in ("control_period", "action_limit"):
        right = getattr(bundle.manifest, name)
        remedy = f": set flow.{name}={right}"
        _check_equal(bundle, name.replace("_", " "), right, getattr(flow, name), owner=owner, remedy=remedy)


def check_vehicle(bundle: Bundle, config: Config) -> None:
    """Raise BundleError if the controller was built for another vehicle, bus or delay of the actuator."""
    manifest = bundle.manifest
    points = (
        ", ".join(f"{field.name} {getattr(point, field.name)}" for field in fields(point))
        for point in (manifest.operating_point, config.operating_point)
    )
    _check_equal(bundle, "operating point", *points, owner="vehicle")
    check_flow(bundle, config.flow, owner="vehicle")
    check_ecu(f"bundle {manifest.name!r}", len(manifest.sensors), manifest.mpc.horizon, config.ecu)


def check_ecu(owner: str, sensors: int, horizon: int, ecu: EcuConfig) -> None:
    """Raise BundleError if `owner`, a model or a release, has too few or too many sensors for the bus, or if its
    horizon is too short for the delay of the actuator."""
    if sensors != SENSORS:
        raise BundleError(f"{owner} has {sensors} sensors: the Pressure message carries {SENSORS}")
    if ecu.frozen_actions >= horizon:
        most, ahead = horizon - 1 - ecu.plan_ahead, ", as ecu.plan_ahead is set" if ecu.plan_ahead else ""
        right = f"must be at most {most} for the horizon of {horizon}{ahead}"
        raise BundleError(f"ecu.delay_steps = {ecu.delay_steps}: {right}")


def check_offset(config: Config) -> int:
    """Return `ecu.step_offset_ms` in ns; raises ConfigError if it is a period or longer."""
    offset_ns = round(config.ecu.step_offset_ms * 1e6)
    if offset_ns >= config.period_ns:
        right = f"must be shorter than the control period of {config.period_ns / 1e6:g} ms"
        raise ConfigError(f"ecu.step_offset_ms = {config.ecu.step_offset_ms:g}: {right}")
    return offset_ns


def check_sensors(bundle: Bundle, layout: SensorLayout) -> None:
    """Raise BundleError if a sensor of the controller is missing on the plant or has another position there."""
    manifest = bundle.manifest
    try:
        columns = layout.indices(manifest.sensors)
    except ConfigError as error:
        raise BundleError(f"bundle {manifest.name!r} is for another plant: {error}") from error
    built_for = positions_of(manifest)
    if built_for is None:
        return
    for name, there, here in zip(manifest.sensors, built_for, layout.positions[columns], strict=True):
        if np.abs(there - here).max() > SAME_PLACE:
            places = ("({:g} W, {:g} W)".format(*place) for place in (there, here))
            where = "its sensor {} is at {}, but on this plant it is at {}".format(name, *places)
            raise BundleError(f"bundle {manifest.name!r} was built for another body: {where}")


def positions_of(manifest: Manifest) -> Array | None:
    """Return a release's sensor positions (S, 2). A bundle without positions is from a version that supported only the
    truck: then the result is the truck's positions of these sensors, or None if the truck lacks one of the sensors."""
    if manifest.sensor_positions is not None:
        return np.array(manifest.sensor_positions)
    return TRUCK.positions[TRUCK.indices(manifest.sensors)] if set(manifest.sensors) <= set(TRUCK.names) else None


def _check_equal(bundle: Bundle, name: str, built_for: object, here: object, *, owner: str, remedy: str = "") -> None:
    if built_for != here:
        bundled = bundle.manifest.name
        raise BundleError(f"bundle {bundled!r} was built for {name} {built_for}, but the {owner} has {here}{remedy}")
