"""The ECU in C for the folder of a C library: its sources, and the settings of one release in one vehicle."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from contract.config.tree import Config
from contract.controller.c_folder import ECU_SETTINGS
from contract.errors import StillwakeError
from contract.release.bundle import Bundle, load
from stillwake.shipped import BUNDLE


def ecu_files(bundle: Path | None, *, config: Config, notice: Callable[[str], None]) -> dict[str, bytes]:
    """The ECU for a release, or nothing where C cannot have it.

    Args:
        bundle: just written; the shipped one if None.
        config: of the vehicle.
        notice: called with a line for what the ECU does without, or for why there is none.
    """
    from export.to_c.library import ecu_sources
    from firmware_sim.ecu.c_settings import ecu_settings

    try:
        release = load(BUNDLE if bundle is None else bundle)
        return ecu_sources() | {ECU_SETTINGS: ecu_settings(release, _without_check(release, config, notice))}
    except StillwakeError as error:
        notice(f"no ECU in C, the library has the control step alone: {error}")
        return {}


def _without_check(release: Bundle, config: Config, notice: Callable[[str], None]) -> Config:
    """The settings, without the check of the sensors for a release that has no estimator; as the ECU in Python."""
    check = config.ecu.sensor_check
    if release.manifest.sensor_estimator is not None or not check.enabled:
        return config
    notice("the ECU in C does not check the sensors: the release has no estimator (--sensors)")
    return replace(config, ecu=replace(config.ecu, sensor_check=replace(check, enabled=False)))
