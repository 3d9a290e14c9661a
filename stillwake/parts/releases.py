"""The functions that open a release bundle for a command, check its signature, and return its calibration."""

from dataclasses import asdict
from pathlib import Path
from typing import Final

from rich.text import Text

from contract.config.loading import Loaded
from contract.controller.calibration import Calibration
from contract.errors import ConfigError
from contract.release import bundle as bundles
from contract.release import signing
from contract.release.checks import UNSIGNED, Bundle
from contract.release.signing import PublicKey
from contract.shipped import BUNDLE
from stillwake.console.settings import COST_WEIGHTS

PROJECT: Final = "project"
"""Value of `trust` that selects the project's key instead of a key file. This key signed the shipped bundle."""


def open_release(path: Path | None, trust: str | None = None) -> Bundle:
    """Load a bundle, by default the shipped bundle. The shipped bundle must have the project's signature unless `trust`
    names another key. Raises BundleError if the bundle does not verify or lacks the signature; KeyFileError if the key
    in `trust` cannot be read."""
    return bundles.load(*locate(path, trust))


def describe(release: Bundle) -> list[Text]:
    """Return lines on an opened bundle: name, sensors and signer, with a warning if the signer is not trusted."""
    manifest = release.manifest
    vouched_for = release.is_trusted or release.signer == signing.project_key()
    return [
        Text(f"bundle {manifest.name} {release.digest[:12]}: {', '.join(manifest.sensors)}"),
        Text(signature(release)) if vouched_for else Text(f"warning: {signature(release)}", style="yellow"),
    ]


def signature(release: Bundle) -> str:
    """Return a description of the bundle's signer."""
    if release.signer is None:
        return UNSIGNED
    if release.signer == signing.project_key():
        return f"signed by the project's key {release.signer.fingerprint}"
    if release.is_trusted:
        return f"signed by the trusted key {release.signer.fingerprint}"
    return f"signed by key {release.signer.fingerprint}, unknown here; `bundle inspect --trust` can require a key"


def locate(path: Path | None, trust: str | None) -> tuple[Path, PublicKey | None]:
    """Return the path of the bundle, by default the shipped bundle, and the key that must have signed the bundle. The
    key is None if any key may have signed it."""
    if trust == PROJECT or (trust is None and path is None):
        trusted: PublicKey | None = signing.project_key()
    else:
        trusted = None if trust is None else signing.read_public_key(Path(trust))
    return BUNDLE if path is None else path, trusted


def asked_calibration(loaded: Loaded, release: Bundle) -> Calibration:
    """Return the release's calibration in this vehicle, with the user's cost weights. Raises ConfigError for a weight
    out of its limits. The bundle fixes the other settings of the optimiser, so a change of these settings also raises
    ConfigError."""
    from ecu.calibrating import limits_of, release_calibration

    built, given = asdict(release.manifest.mpc), asdict(loaded.config.mpc)
    for name in sorted(item for item in loaded.given if item.startswith("mpc.") and not item.startswith(COST_WEIGHTS)):
        key = name.removeprefix("mpc.")
        if name in loaded.in_overrides or given[key] != built[key]:
            raise ConfigError(
                f"{name} = {given[key]}: this setting is fixed to {built[key]} in the bundle; make another bundle with "
                f"`stillwake export MODEL BUNDLE --set {name}={given[key]}`"
            )
    asked = [name.removeprefix(f"{COST_WEIGHTS}.") for name in loaded.given if name.startswith(f"{COST_WEIGHTS}.")]
    own = release_calibration(release, loaded.config)
    return limits_of(release, loaded.config).changed(own, {name: given["weights"][name] for name in asked})
