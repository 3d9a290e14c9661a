"""The image of a release: the ECU in C runs it instead of the release that was compiled in (`sw_image.h`)."""

from collections.abc import Mapping
from pathlib import Path

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from contract.config.tree import Config
from contract.controller import image_payload as payloads
from contract.controller.c_folder import ECU_SETTINGS, ProgramSettings
from contract.errors import LibraryError
from contract.release.checks import Bundle, dbc_sha256
from contract.release.controller_image import ImageFacts, seal
from ecu.in_c.c_settings import release_numbers


def read_packed(folder: Path) -> dict[str, bytes]:
    """Read the packed weights and the packed estimator in a library's folder; raise LibraryError if this fails."""
    paths = (folder / name for name in (payloads.WEIGHTS_PART, payloads.ESTIMATOR_PART))
    try:
        return {path.name: path.read_bytes() for path in paths if path.is_file()}
    except OSError as error:
        raise LibraryError(f"library {folder}: {error.strerror or error}") from error


def controller_image(
    files: Mapping[str, bytes], bundle: Bundle, config: Config, key: Ed25519PrivateKey | None
) -> bytes:
    """Return the image of a verified release, signed if there is a key. `files` has the library with its ECU and packed
    numbers. Raises LibraryError if a file is missing or belongs to another controller; BundleContainerError if an
    image has no space for the release's name, or if ECUs would refuse one of the release's numbers."""
    manifest = bundle.manifest
    for name in (payloads.WEIGHTS_PART, ECU_SETTINGS):
        if name not in files:
            raise LibraryError(f"no image: {name} is missing, so the library has no ECU in C")
    if ProgramSettings.of(files).text("SW_PROGRAM_SHA256") != manifest.program_sha256:
        raise LibraryError(f"no image: the library does not belong to the program of bundle {manifest.name!r}")
    point, layout = manifest.operating_point, payloads.sha256_of(payloads.layout_of(files))
    facts = ImageFacts(
        layout=layout,
        dbc=bytes.fromhex(dbc_sha256()),
        digest=bytes.fromhex(bundle.digest),
        security_version=manifest.security_version,
        period_ns=config.period_ns,
        operating_point=(point.width, point.speed, point.density),
        action_limit=manifest.action_limit,
        sensors=len(manifest.sensors),
        hardware=manifest.hardware,
        name=manifest.name,
    )
    payload = payloads.payload_of({**files, payloads.RELEASE_PART: release_numbers(bundle, config).packed()})
    payloads.check_numbers(payload, layout)
    return seal(payload, facts, key)
