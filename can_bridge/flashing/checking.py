"""Whether an image may run on this ECU: every check of a bundle, and the ECU's own rules."""

from collections.abc import Callable
from dataclasses import dataclass

from can_bridge.flashing.verdicts import Verdict
from contract.errors import BundleDbcError, BundleError, BundleSignatureError, BundleSignerError
from contract.release import signing
from contract.release.bundle import verified
from contract.release.checks import SIGNATURE, Bundle
from contract.release.image import files_of
from contract.release.key_list import KeyList
from contract.release.manifest import MANIFEST

Fits = Callable[[Bundle], Verdict]
"""Whether a bundle was made for this vehicle: GOOD, WRONG_PERIOD or WRONG_VEHICLE."""


@dataclass(frozen=True, kw_only=True)
class Rules:
    """What an image is judged by.

    Attributes:
        keys: that may sign; None where the ECU has no key list, and so takes nothing.
        hardware: name of this ECU's.
        least_security_version: that a release must have.
    """

    keys: KeyList | None
    hardware: str
    fits: Fits
    least_security_version: int


def check(image: bytes, rules: Rules) -> tuple[Verdict, Bundle | None]:
    """The first check that an image fails, or GOOD and its bundle. Nothing is parsed before its signature is good."""
    files = {}
    try:
        files = files_of(image)
        bundle = verified("image", files, frozenset() if rules.keys is None else rules.keys.keys)
    except BundleSignerError:
        return _signer_verdict(files.get(SIGNATURE), files[MANIFEST], rules.keys), None
    except BundleSignatureError:
        return Verdict.BAD_SIGNATURE, None
    except BundleDbcError:
        return Verdict.WRONG_DBC, None
    except BundleError:
        return Verdict.DAMAGED, None
    if bundle.manifest.hardware not in (None, rules.hardware):
        return Verdict.WRONG_HARDWARE, None
    if (verdict := rules.fits(bundle)) != Verdict.GOOD:
        return verdict, None
    if bundle.manifest.security_version < rules.least_security_version:
        return Verdict.TOO_OLD, None
    return Verdict.GOOD, bundle


def _signer_verdict(signature: bytes | None, manifest: bytes, keys: KeyList | None) -> Verdict:
    """Why no allowed key signed it; the signature is known to be good where there is one."""
    if signature is None:
        return Verdict.UNSIGNED
    is_revoked = keys is not None and signing.signer(signature, manifest) in keys.revoked
    return Verdict.REVOKED_KEY if is_revoked else Verdict.UNKNOWN_KEY
