"""A bundle against what an ECU reports of itself: what the ECU would refuse is an error before a byte is sent.

The ECU makes these checks again, and more: it alone knows which keys may sign.
"""

from collections.abc import Iterator

from can_bridge.tester.facts import EcuFacts
from can_bridge.tester.messages import WrongReleaseError
from contract.release.checks import Bundle, dbc_sha256


def check_fits(release: Bundle, length: int, facts: EcuFacts) -> None:
    """Raises WrongReleaseError for the first thing that does not fit.

    Args:
        release: of this version's DBC, as every bundle that was loaded.
        length: of its image, bytes.
    """
    for line in _misfits(release, length, facts):
        raise WrongReleaseError(f"bundle {release.manifest.name} {line}; nothing was written")


def _misfits(release: Bundle, length: int, facts: EcuFacts) -> Iterator[str]:
    manifest = release.manifest
    period_ns = manifest.operating_point.period_ns(manifest.control_period)
    least = facts.store.least_security_version
    if release.signer is None:
        yield "is not signed, and an ECU takes signed ones alone: `stillwake bundle sign` signs it"
    if manifest.hardware not in (None, facts.hardware):
        yield f"is for hardware {manifest.hardware}, the ECU is {facts.hardware}"
    if facts.dbc_sha256 != dbc_sha256():
        yield (
            f"is for the stillwake.dbc {dbc_sha256()[:12]}, the ECU has {facts.dbc_sha256[:12]} (stillwake "
            f"{facts.software_version}): `stillwake bundle renew` of that version makes one"
        )
    if period_ns != facts.period_ns:
        yield f"has a control period of {period_ns / 1e6:g} ms, the ECU one of {facts.period_ns / 1e6:g} ms"
    if manifest.security_version < least:
        yield f"has security version {manifest.security_version}, the ECU takes {least} or greater"
    if length > facts.capacity:
        yield f"has {length} bytes, the ECU has room for {facts.capacity}"
