"""The checks of an image for this ECU: all checks of a bundle or a controller image, and the ECU's own rules."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from can_bridge.flashing.verdicts import Verdict
from contract.errors import BundleDbcError, BundleError, BundleSignatureError, BundleSignerError
from contract.release import controller_image, signing
from contract.release.checks import SIGNATURE, Bundle, dbc_sha256, read_checked
from contract.release.container import files_of
from contract.release.controller_image import ControllerImage
from contract.release.key_list import KeyList
from contract.release.manifest import MANIFEST
from contract.release.signing import PublicKey

Release = Bundle | ControllerImage
"""The content of a valid image."""
Fits = Callable[[Any], Verdict]
"""A function that returns whether a checked release is for this vehicle: GOOD, WRONG_PERIOD or WRONG_VEHICLE."""


@dataclass(frozen=True, kw_only=True)
class Rules:
    """The ECU's own rules for images. `keys` is the key list; if it is None, no image is accepted."""

    keys: KeyList | None
    hardware: str
    fits: Fits
    least_security_version: int


def check(image: bytes, rules: Rules) -> tuple[Verdict, Bundle | None]:
    """Return GOOD and the image's bundle. If a check fails, return the verdict of the first failed check, and None.
    Only the container is parsed before the signature is verified."""
    files = {}
    try:
        files = files_of(image)
        bundle = read_checked(Path("image"), files, frozenset() if rules.keys is None else rules.keys.keys)
    except BundleSignerError:
        signature = files.get(SIGNATURE)
        signer = None if signature is None else signing.signer(signature, files[MANIFEST])
        return _signer_verdict(signer, rules.keys), None
    except BundleSignatureError:
        return Verdict.BAD_SIGNATURE, None
    except BundleDbcError:
        return Verdict.WRONG_DBC, None
    except BundleError:
        return Verdict.DAMAGED, None
    verdict = _own_verdict(bundle, bundle.manifest.hardware, rules)
    return verdict, bundle if verdict == Verdict.GOOD else None


ImageCheck = Callable[[bytes, Rules], tuple[Verdict, Release | None]]
"""A function like `check`, for any kind of image."""


def judge_image(
    image: bytes, rules: Rules, *, layout: bytes, opens: Callable[[bytes], bool] = lambda payload: True
) -> tuple[Verdict, ControllerImage | None]:
    """Check a controller image, as `check` checks a bundle. `layout` identifies this ECU's build. The last check calls
    `opens`, which returns whether the build can run a payload (`sw_image_open`)."""
    keys = rules.keys
    try:
        signer = controller_image.signer_of(image)
        if signer is None or keys is None or signer not in keys.keys:
            return _signer_verdict(signer, keys), None
        found = controller_image.read(image)
    except BundleSignatureError:
        return Verdict.BAD_SIGNATURE, None
    except BundleError:
        return Verdict.DAMAGED, None
    facts = found.facts
    if facts.dbc.hex() != dbc_sha256():
        return Verdict.WRONG_DBC, None
    if facts.layout != layout:
        return Verdict.WRONG_BUILD, None
    verdict = _own_verdict(found, facts.hardware, rules)
    if verdict == Verdict.GOOD and not opens(found.payload):
        verdict = Verdict.WRONG_BUILD
    return verdict, found if verdict == Verdict.GOOD else None


def fits_as(image: bytes) -> Fits:
    """Return a function that checks whether a release is for the same vehicle as this controller image."""
    own = image[controller_image.VEHICLE]

    def fits(found: ControllerImage) -> Verdict:
        other = found.facts.vehicle
        if other[:8] != own[:8]:
            return Verdict.WRONG_PERIOD
        return Verdict.GOOD if other == own else Verdict.WRONG_VEHICLE

    return fits


def _own_verdict(release: Release, hardware: str | None, rules: Rules) -> Verdict:
    """Return the verdict of the ECU's own rules on a release whose content is valid."""
    if hardware not in (None, rules.hardware):
        return Verdict.WRONG_HARDWARE
    verdict = rules.fits(release)
    if verdict == Verdict.GOOD and release.security_version < rules.least_security_version:
        return Verdict.TOO_OLD
    return verdict


def _signer_verdict(signer: PublicKey | None, keys: KeyList | None) -> Verdict:
    """Return the verdict on a signer that is not in the list; None stands for an image without a signature."""
    if signer is None:
        return Verdict.UNSIGNED
    return Verdict.REVOKED_KEY if keys is not None and signer in keys.revoked else Verdict.UNKNOWN_KEY
