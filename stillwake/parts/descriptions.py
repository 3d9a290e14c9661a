"""The descriptions of a release's ECU for other tools: its messages, its calibration and its diagnosis."""

from typing import Final

from contract.config.tree import Config
from contract.release.checks import Bundle, dbc_bytes

A2L: Final = "stillwake.a2l"


def descriptions(release: Bundle, config: Config) -> dict[str, bytes]:
    """Return all descriptions, by the names of their files. Raises BundleError if the release is for another
    vehicle."""
    from can_bridge.calibration.a2l import a2l_text
    from can_bridge.calibration.segment import Segment
    from can_bridge.odx.pdx import pdx
    from can_bridge.odx.seed_and_key import SEED_AND_KEY, seed_and_key
    from ecu.calibrating import limits_of, release_calibration
    from ecu.fit import check_vehicle
    from firmware_sim.runs.reasons import BECAUSE

    check_vehicle(release, config)
    segment = Segment(release_calibration(release, config), limits_of(release, config))
    a2l = a2l_text(segment, release=release.manifest.name, bus=config.bus, period_ns=config.period_ns)
    return {
        "stillwake.dbc": dbc_bytes(),
        A2L: a2l.encode(),
        "stillwake.pdx": pdx(config.bus, BECAUSE),
        SEED_AND_KEY: seed_and_key(),
    }
