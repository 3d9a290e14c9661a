"""The constants of the ECU in C: messages of the DBC, parameters of a release, settings of a vehicle.

They are written to `sw_ecu_settings.h` in a library's folder, so that no number of the ECU in Python is repeated in the
C sources. A floating-point number is written with all its digits, and is a double unless stated otherwise.
"""

from dataclasses import replace
from operator import attrgetter
from typing import Final

import numpy as np

from can_bridge.calibration.daq import cycle_of
from can_bridge.command_gate import GateLimits
from can_bridge.e2e.profiles import profile_of
from can_bridge.wire import message_specs as wire
from can_bridge.wire.classic_codec import CLASSIC_BUS_OFF_LIMIT, CLASSIC_COUNT_LIMIT, STALE_NS
from can_bridge.wire.message_sets import message_set
from can_bridge.wire.messages import BUS_OFF_LIMIT, COUNT_LIMIT, ERROR_LIMIT, Mode, Reason
from contract.config.controller import CostWeights
from contract.config.diagnosis import DiagnosisConfig
from contract.config.tree import Config
from contract.config.vehicle import SpeedConfig
from contract.controller.air_speed import FIRST_PERIOD, LAGS, MEAN_PERIODS, feature_count
from contract.controller.c_folder import ECU_SETTINGS, Numbers, float_literal, generated_header
from contract.controller.calibration import LARGEST_WEIGHT, Calibration
from contract.controller.interface import TERMS
from contract.errors import ConfigError, LibraryError
from contract.release import manifest as manifests
from contract.release.checks import Bundle
from ecu import benefit_check, sensor_check, speed_reception
from ecu.calibrating import limits_of, release_calibration
from ecu.fit import check_vehicle
from ecu.pressure_reception import SILENCE_NS
from ecu.timing import LATEST_NS

HEADER: Final = ECU_SETTINGS
_COUNTS: Final = (
    *("ecu.deadline_misses", "ecu.hold_periods", "ecu.decay_periods", "ecu.rearm_frames"),
    *("ecu.sensor_check.doubt_periods", "ecu.sensor_check.flat_periods", "ecu.benefit_check.mean_periods"),
    *("ecu.benefit_check.wake_periods", "ecu.benefit_check.first_period", "ecu.benefit_check.doubt_periods"),
)
_MOST: Final = {"ecu.loss_window": 64, "ecu.deadline_window": 32, "bus.e2e.window": 254} | dict.fromkeys(_COUNTS, 2**29)
"""Largest values, in periods, that the ECU in C can store or add without overflow."""
_CLASSIC_ONLY: Final = {"SW_PRESSURE_INVALID": f"({-wire.INT12_MAX - 1})", "SW_STALE_NS": f"INT64_C({STALE_NS})"}
_GREATEST_WEIGHTS: Final = CostWeights(**dict.fromkeys(TERMS, LARGEST_WEIGHT))
"""The largest cost weights of a calibration; the C code also allows the release's own weight if it is larger."""
_LONGEST_PERIOD_NS: Final = 2**53
"""Longest control period in ns. Doubles represent integers up to this number exactly, so both ECUs' gates agree."""


def ecu_settings(bundle: Bundle, config: Config) -> bytes:
    """Return `sw_ecu_settings.h` for a verified release in a vehicle. Raises BundleError if the two do not fit
    (`ecu.fit.check_vehicle`); ConfigError if the C ECU does not support a setting; LibraryError if the settings enable
    the sensor check, but the release has no sensor estimator."""
    check_vehicle(bundle, config)
    check_settings(config)
    what = "the DBC's messages, a release's figures, a vehicle's settings"
    return generated_header(HEADER, what, _definitions(bundle, config))


def check_settings(config: Config) -> None:
    """Raise ConfigError for a setting that the ECU in C never supports, whatever the release."""
    for name, most in _MOST.items():
        value = attrgetter(name)(config)
        if value > most:
            raise ConfigError(f"{name} = {value}: the ECU in C accepts at most {most}")
    if config.period_ns > _LONGEST_PERIOD_NS:
        raise ConfigError(f"control period = {config.period_ns} ns: the ECU in C accepts at most {_LONGEST_PERIOD_NS}")
    held_ns = GateLimits.from_config(config).held_age_ns
    if held_ns > LATEST_NS:
        wrong = f"ecu.hold_periods and ecu.decay_periods add up to {held_ns} ns"
        raise ConfigError(f"{wrong}: the ECU in C accepts at most {LATEST_NS}")


def _definitions(bundle: Bundle, config: Config) -> dict[str, int | float | str]:
    manifest, messages, limits = bundle.manifest, message_set(config.bus), GateLimits.from_config(config)
    ecu, e2e, check = config.ecu, config.bus.e2e, config.ecu.sensor_check
    estimator = manifest.sensor_estimator if check.enabled else None
    if check.enabled and estimator is None:
        raise LibraryError("the release has no sensor estimator: set ecu.sensor_check.enabled=false")
    calibration_limits = limits_of(bundle, config)
    found: dict[str, int | float | str] = {}
    for name, spec in zip(("PRESSURE", "SPEED", "COMMAND", "STATUS"), messages.specs, strict=True):
        numbers = {"ID": spec.frame_id, "BYTES": spec.protected, "DATA_ID": spec.data_id}
        numbers |= {"SECURED": spec.length} if spec.is_secured else {}
        found |= {f"SW_{name}_{part}": number for part, number in numbers.items()}
    spec = messages.pressure.spec
    return found | {
        **_of_diagnosis(config.bus.diagnosis, config.period_ns),
        "SW_FRAMES_FD": int(spec.is_fd),
        "SW_SECOC": int(spec.is_secured),
        "SW_E2E_PROFILE": spec.profile,
        "SW_E2E_COUNTERS": profile_of(spec).counter_period,
        "SW_PRESSURE_RESOLUTION_PA": messages.pressure_resolution_pa,
        "SW_AGE_RESOLUTION_NS": wire.AGE_RESOLUTION_NS if spec.is_fd else wire.CLASSIC_AGE_RESOLUTION_NS,
        "SW_SPEED_RESOLUTION": wire.SPEED_RESOLUTION_M_PER_S,
        "SW_SPEED_UNKNOWN": f"{wire.SPEED_UNKNOWN}u",
        "SW_DENSITY_RESOLUTION": wire.DENSITY_RESOLUTION_KG_PER_M3,
        "SW_FLOW_RESOLUTION": wire.FLOW_RESOLUTION_M2_PER_S,
        "SW_COUNT_LIMIT": COUNT_LIMIT if spec.is_fd else CLASSIC_COUNT_LIMIT,
        "SW_BUS_OFF_LIMIT": BUS_OFF_LIMIT if spec.is_fd else CLASSIC_BUS_OFF_LIMIT,
        **({"SW_ERROR_LIMIT": ERROR_LIMIT} if spec.is_fd else _CLASSIC_ONLY),
        **{f"SW_MODE_{item.name}": item.value for item in Mode},
        **{f"SW_REASON_{item.name}": item.value for item in Reason},
        "SW_BUNDLE_HASH": f"UINT32_C({bundle.short_hash:#010x})",
        **_of_release(release_numbers(bundle, config)),
        "SW_DELAY_STEPS": f"{ecu.delay_steps}u",
        "SW_LEAST_CALIBRATION": _calibration(calibration_limits.least),
        "SW_GREATEST_CALIBRATION": _calibration(replace(calibration_limits.greatest, weights=_GREATEST_WEIGHTS)),
        **_named("SW_E2E", e2e, "max_delta", "window", "min_ok", "max_errors"),
        "SW_PERIOD_NS": f"INT64_C({config.period_ns})",
        "SW_STEP_OFFSET_NS": f"INT64_C({round(ecu.step_offset_ms * 1e6)})",
        **_named("SW", ecu, "hold_periods", "decay_periods", "rearm_frames", "loss_window", "loss_limit"),
        **_named("SW", ecu, "deadline_misses", "deadline_window"),
        "SW_PLAN_AHEAD": int(ecu.plan_ahead),
        "SW_SILENCE_NS": f"INT64_C({SILENCE_NS})",
        "SW_FLOW_SCALE": config.operating_point.flow_rate_scale,
        "SW_DYNAMIC_PRESSURE": config.operating_point.dynamic_pressure,
        "SW_GATE_FLOW": limits.flow_m2_per_s,
        "SW_GATE_STEP": limits.step_m2_per_s,
        "SW_FRESH_AGE_NS": f"INT64_C({limits.fresh_age_ns})",
        "SW_HELD_AGE_NS": f"INT64_C({limits.held_age_ns})",
        **_of_speeds(manifest, ecu.speed),
        **_of_benefit_check(benefit_check.BenefitCheck.of(manifest, ecu.benefit_check)),
        "SW_SENSOR_CHECK": int(estimator is not None),
        **_named("SW", check, "liar_level", "bias_level", "swap_level", "doubt_level", "doubt_periods", "flat_periods"),
        **_named("SW", manifests, "FAST_PERIODS", "SLOW_PERIODS"),
        **_named("SW", sensor_check, "SCORE_PERIODS", "NOISE_ALLOWED", "MOVING", "ALIKE", "COPIED"),
        **_named("SW", sensor_check, "DRIFT_ALLOWED", "ASIDE_ALLOWED"),
    }


def _named(prefix: str, owner: object, *names: str) -> dict[str, int | float | str]:
    """Return attributes of `owner` by their names in C: `prefix`, an underscore, and the name in capitals."""
    return {f"{prefix}_{name.upper()}": getattr(owner, name) for name in names}


def release_numbers(bundle: Bundle, config: Config) -> Numbers:
    """Return the `sw_release` of a verified release: the numbers that no vehicle's setting changes (0 if missing)."""
    manifest, estimator, speeds = bundle.manifest, bundle.manifest.sensor_estimator, bundle.manifest.speeds
    check = benefit_check.BenefitCheck.of(manifest, replace(config.ecu.benefit_check, enabled=True))
    nothing, point = np.zeros((len(manifest.sensors),) * 2), manifest.operating_point
    members = {
        "fast_deviation": nothing if estimator is None else np.array(estimator.fast),
        "slow_deviation": nothing if estimator is None else np.array(estimator.slow),
        "resting": np.array(benefit_check.resting_of(manifest)),
        "slowest": np.array(0.0 if speeds is None else speeds.slowest),
        "fastest": np.array(0.0 if speeds is None else speeds.fastest),
        "design_speed": np.array(float(point.speed)),
        "design_density": np.array(float(point.density)),
        "weights": np.array(release_calibration(bundle, config).values[:-3], np.float32),
        "air_speed": np.array(manifest.air_speed or (0.0,), np.float32),
        "bundle_hash": np.array(bundle.short_hash, np.uint32),
        "base": np.array([0] if check is None else check.base, np.uint8),
        "pairs": np.array([[0, 0]] if check is None else check.pairs, np.uint8),
    }
    ends = 4 + sum(members[name].nbytes for name in ("base", "pairs", "weights", "air_speed"))
    # Compilers pad a struct to different sizes, so the padding is a separate member.
    return Numbers(struct="sw_release", members={**members, "reserved": np.zeros(8 - ends % 8, np.uint8)})


def _of_release(numbers: Numbers) -> dict[str, int | float | str]:
    members = numbers.members
    return {
        "SW_BASES": len(members["base"]),
        "SW_MIRRORED_PAIRS": len(members["pairs"]),
        "SW_RESTING_SPEEDS": len(members["resting"]),
        "SW_AIR_WEIGHTS": len(members["air_speed"]),
        "SW_RELEASE_RESERVED": len(members["reserved"]),
        "SW_RELEASE": numbers.initialiser.replace("\n", " "),
        "SW_RELEASE_AS_PACKED": numbers.as_packed,
        **numbers.settings("SW_RELEASE"),
    }


def _of_diagnosis(config: DiagnosisConfig, period_ns: int) -> dict[str, int | float | str]:
    """Return the settings of diagnosis. The setting of a disabled function is 0."""
    cycle, unit = cycle_of(period_ns)
    return {
        "SW_DIAGNOSIS_EXTENDED": int(config.request.is_extended),
        "SW_REQUEST_ID": f"{config.request.number:#x}u",
        "SW_RESPONSE_ID": f"{config.response.number:#x}u",
        "SW_FUNCTIONAL": int(config.functional is not None),
        "SW_FUNCTIONAL_ID": f"{config.functional.number if config.functional else 0:#x}u",
        "SW_XCP": int(config.xcp),
        "SW_XCP_EXTENDED": int(config.xcp_command.is_extended),
        "SW_XCP_COMMAND_ID": f"{config.xcp_command.number:#x}u",
        "SW_XCP_RESPONSE_ID": f"{config.xcp_response.number:#x}u",
        "SW_XCP_CYCLE": f"{cycle}u",
        "SW_XCP_CYCLE_UNIT": f"{unit}u",
    }


def _of_speeds(manifest: manifests.Manifest, config: SpeedConfig) -> dict[str, int | float | str]:
    """Return the settings for a release with a range of speeds; for another, SW_PAST and SW_AIR_SPEED, both 0."""
    if manifest.speeds is None:
        return {"SW_PAST": 0, "SW_AIR_SPEED": 0}
    return {
        "SW_PAST": manifest.past,
        "SW_AIR_SPEED": int(manifest.air_speed is not None),
        "SW_AIR_FEATURES": feature_count(len(manifest.sensors) // 2),
        "SW_AIR_LAGS": f"{{{', '.join(map(str, LAGS))}}}",
        "SW_AIR_MEAN_PERIODS": f"{MEAN_PERIODS}u",
        "SW_AIR_FIRST_PERIOD": f"{FIRST_PERIOD}u",
        **_named("SW_AIR", speed_reception, "TOLERATED", "MOST_REST", "RATE"),
        "SW_MOST_CORRECTION": float(config.most_correction),
        "SW_SPEED_MARGIN": float(config.margin),
        "SW_OLDEST_SPEED_NS": f"INT64_C({round(config.oldest_ms * 1e6)})",
        "SW_SHORTEST_S": speed_reception.SHORTEST_S,
        "SW_MOST_ACCELERATION": float(config.most_acceleration),
    }


def _of_benefit_check(check: benefit_check.BenefitCheck | None) -> dict[str, int | float | str]:
    if check is None:
        return {"SW_BENEFIT_CHECK": 0}
    config = check.config
    return {
        "SW_BENEFIT_CHECK": 1,
        "SW_MEAN_PERIODS": f"{config.mean_periods}u",
        "SW_WAKE_PERIODS": f"{config.wake_periods}u",
        "SW_PROVEN_PERIODS": f"{check.proven}u",
        "SW_FIRST_PERIOD": f"{config.first_period}u",
        **_named("SW", config, "least_gain", "most_swing"),
        "SW_BENEFIT_DOUBT": f"{config.doubt_periods}u",
        "SW_PATIENCE": f"{check.patience}u",
        "SW_MOVED": benefit_check.MOVED,
    }


def _calibration(values: Calibration) -> str:
    *weights, action_limit, command_step = (float_literal(np.float32(value)) for value in values.values[:-1])
    return f"{{{{{', '.join(weights)}}}, {action_limit}, {command_step}, {values.delay_steps}u}}"
