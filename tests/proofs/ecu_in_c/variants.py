"""Vehicles in which both ECUs are compared; each makes a library of its own of the ECU in C."""

from dataclasses import replace
from typing import Final

from can_bridge.secoc.key import Key
from can_bridge.secoc.securing import Authentication
from can_bridge.wire.message_sets import SECURED
from contract.config.tree import Config
from contract.config.vehicle import BenefitCheckConfig, BusConfig, E2eConfig, EcuConfig, SensorCheckConfig, SpeedConfig
from contract.controller.air_speed import LAGS, weight_count
from contract.controller.calibration import LARGEST_WEIGHT
from contract.release.checks import Bundle
from contract.release.manifest import RestingWake, SensorEstimator, SpeedRange
from tests.proofs.ecu.hostile_world import small_bundle

UNCHECKED: Final = SensorCheckConfig(enabled=False)
QUICK: Final = SensorCheckConfig(
    liar_level=3.0, bias_level=4.0, swap_level=0.5, doubt_level=2.0, doubt_periods=4, flat_periods=3
)
"""To set sensors aside and to doubt them, so that it often happens."""
HASTY: Final = BenefitCheckConfig(mean_periods=3, wake_periods=4, first_period=2, doubt_periods=2)
"""To find that control does not help, likewise."""

_CLASSIC: Final = BusConfig(frames="classic")
_LATE: Final = EcuConfig(
    delay_steps=2, hold_periods=3, decay_periods=3, loss_window=64, loss_limit=30, deadline_window=32,
    deadline_misses=6, rearm_frames=1, sensor_check=UNCHECKED,
)  # fmt: skip
_IMPATIENT: Final = EcuConfig(
    hold_periods=0, decay_periods=0, loss_window=1, loss_limit=1, deadline_window=1, deadline_misses=1,
    pressure_age=1.0, plan_ahead=False, sensor_check=UNCHECKED, benefit_check=BenefitCheckConfig(enabled=False),
)  # fmt: skip

VARIANTS: Final = {
    "as shipped": Config(),
    "not planning ahead": Config(ecu=EcuConfig(plan_ahead=False, sensor_check=UNCHECKED)),
    "late actuator, long windows": Config(
        bus=BusConfig(e2e=E2eConfig(window=12, min_ok=4, max_errors=3, max_delta=127)), ecu=_LATE
    ),
    "quick to doubt": Config(ecu=EcuConfig(sensor_check=QUICK, benefit_check=HASTY, deadline_misses=11)),
    "authenticated": Config(bus=BusConfig(key="bus.key"), ecu=EcuConfig(sensor_check=UNCHECKED, deadline_misses=11)),
    "authenticated, at all speeds": Config(
        bus=BusConfig(key="bus.key", e2e=E2eConfig(window=4, min_ok=1, max_errors=1)),
        ecu=EcuConfig(plan_ahead=False, sensor_check=UNCHECKED, speed=SpeedConfig(oldest_ms=60.0)),
    ),
    "classic": Config(bus=_CLASSIC, ecu=EcuConfig(sensor_check=QUICK, benefit_check=HASTY, delay_steps=1)),
    "classic, impatient": Config(
        bus=replace(_CLASSIC, e2e=E2eConfig(window=1, min_ok=1, max_errors=0, max_delta=1)), ecu=_IMPATIENT
    ),
    "at all speeds": Config(
        ecu=EcuConfig(
            sensor_check=SensorCheckConfig(flat_periods=3),
            deadline_misses=11,
            speed=SpeedConfig(oldest_ms=60.0, most_acceleration=150.0, most_correction=0.3),
        )
    ),
    "classic, at all speeds": Config(
        bus=_CLASSIC,
        ecu=EcuConfig(delay_steps=2, plan_ahead=False, sensor_check=UNCHECKED, speed=SpeedConfig(margin=0.1)),
    ),
}
"""All sets of messages; planning ahead or not; late actuators; with and without the checks; windows of one period and
of as many as C has room for; releases for a range of speeds, where the speed's settings are not the default ones."""

SPEEDS: Final = SpeedRange(slowest=0.6, fastest=1.4)
RESTING: Final = RestingWake(speeds=(0.7, 0.9, 1.3), base=(-0.3, -0.5, -0.45), swing=(0.1, 0.3, 0.7))
"""Narrower than the speeds, and not of the design speed."""
AIR_SPEED: Final = tuple(((number * 7) % 11 - 5.5) / 40 for number in range(weight_count(2)))
"""Weights of either sign and none zero, so that the estimate goes either way."""

KEY: Final = Key(bytes(range(1, 17)))
HEARD: Final = {SECURED.pressure.spec.frame_id: 5 << 32 | 40, SECURED.speed.spec.frame_id: 5 << 32 | 7}
"""Freshness values of an earlier power cycle."""
AUTHENTICATION: Final = Authentication(key=KEY, trip=7, heard=HEARD)
"""What an ECU is given of the bus' key; `twin.c` gives the same."""


DEVIATION: Final = 0.02  # deviation of sound sensors' residuals in Cp, which the traffic's estimates have


def bundle_of(config: Config) -> Bundle:
    """A release of a few periods' window and horizon, with a sensor estimator's figures and no model."""
    bundle = small_bundle(config)
    rows = tuple(tuple(DEVIATION * (1.0 + 0.1 * (i + 2 * j)) for i in range(4)) for j in range(4))
    figures = SensorEstimator(fast=rows, slow=rows)
    is_driven = config.ecu.speed != SpeedConfig()
    # One kind of release has a weight of its own that no calibration of another could have, and one beside the
    # weights of the estimate.
    heavy = replace(bundle.manifest.mpc.weights, effort=2.0 * LARGEST_WEIGHT, prior=0.5)
    # Some state what their wake is without jets.
    stated = RESTING if is_driven or config.bus.frames == "fd" else None
    manifest = replace(bundle.manifest, sensor_estimator=figures, resting=stated)
    if is_driven:
        manifest = replace(manifest, speeds=SPEEDS, mpc=replace(manifest.mpc, weights=heavy))
    if config.ecu.speed.most_correction != SpeedConfig.most_correction:
        manifest = replace(manifest, window=max(LAGS) + 1, air_speed=AIR_SPEED)
    return replace(bundle, manifest=manifest)
