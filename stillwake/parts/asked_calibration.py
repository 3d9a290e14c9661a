"""The calibration of an ECU by the settings that a user gave."""

from dataclasses import asdict

from contract.config.loading import Loaded
from contract.controller.calibration import Calibration
from contract.errors import ConfigError
from contract.release.checks import Bundle
from stillwake.console.settings import WEIGHTS


def asked_calibration(loaded: Loaded, release: Bundle) -> Calibration:
    """The release's own calibration in this vehicle, with the weights that the user gave. Raises ConfigError for a
    weight out of the limits, or another setting of the optimiser: it is fixed in the bundle."""
    from ecu.calibrating import limits_of, release_calibration

    built, given = asdict(release.manifest.mpc), asdict(loaded.config.mpc)
    for name in sorted(item for item in loaded.given if item.startswith("mpc.") and not item.startswith(WEIGHTS)):
        key = name.removeprefix("mpc.")
        if name in loaded.in_overrides or given[key] != built[key]:
            raise ConfigError(
                f"{name} = {given[key]}: fixed when the bundle was exported, to {built[key]}; make another bundle with "
                f"`stillwake export MODEL BUNDLE --set {name}={given[key]}`"
            )
    asked = [name.removeprefix(f"{WEIGHTS}.") for name in loaded.given if name.startswith(f"{WEIGHTS}.")]
    own = release_calibration(release, loaded.config)
    return limits_of(release, loaded.config).changed(own, {name: given["weights"][name] for name in asked})
