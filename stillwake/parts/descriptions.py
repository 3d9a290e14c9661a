"""Descriptions of a release's ECU for other tools: its messages, its calibration and its diagnosis."""

from typing import Final

from contract.config.tree import Config
from contract.release.checks import Bundle, dbc_bytes

A2L: Final = "stillwake.a2l"


def a2l_of(release: Bundle, config: Config) -> bytes:
    """Return the A2L file of the release's calibration. Raises BundleError if the release is for another vehicle."""
    from can_bridge.calibration.a2l import a2l_text
    from can_bridge.calibration.segment import Segment
    from ecu.calibrating import limits_of, release_calibration
    from ecu.fit import check_vehicle

    check_vehicle(release, config)
    return a2l_text(
        Segment(release_calibration(release, config), limits_of(release, config)),
        release=release.manifest.name,
        bus=config.bus,
        period_ns=config.period_ns,
    ).encode()


def pdx_of(config: Config) -> bytes:
    """Return the PDX file of the ECU's diagnosis."""
    from can_bridge.odx.pdx import pdx
    from firmware_sim.runs.reasons import BECAUSE

    return pdx(config.bus, BECAUSE)


def descriptions(release: Bundle, config: Config) -> dict[str, bytes]:
    """Return all descriptions, by the names of their files."""
    from can_bridge.odx.seed_and_key import SEED_AND_KEY, seed_and_key

    return {
        "stillwake.dbc": dbc_bytes(),
        A2L: a2l_of(release, config),
        "stillwake.pdx": pdx_of(config),
        SEED_AND_KEY: seed_and_key(),
    }
