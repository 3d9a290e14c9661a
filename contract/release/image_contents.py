"""What a controller image holds, for people and for comparison: the header's facts, and the numbers by name."""

from pathlib import Path
from typing import Final

import numpy as np

from contract.controller.image_payload import arrays_in, check_numbers, layout_in
from contract.errors import BundleContainerError, BundleSignerError
from contract.release.checks import sha256
from contract.release.controller_image import SUFFIX, ControllerImage, read
from contract.release.signing import PublicKey

MAX_BYTES: Final = 64 * 2**20
_FEW: Final = 8
"""So many numbers are shown as they are; of more, the type, the sides and the hash."""


def is_image(path: Path) -> bool:
    """By its name."""
    return path.suffix.lower() == SUFFIX


def opened(path: Path, trusted: PublicKey | None = None) -> ControllerImage:
    """The image in a file.

    Raises:
        BundleContainerError: it cannot be read, is damaged, no image, or one that no ECU opens.
        BundleSignatureError: the signature is not that of the key in it.
        BundleSignerError: it is not signed by the key that is to be trusted.
    """
    try:
        if path.stat().st_size > MAX_BYTES:
            raise BundleContainerError(f"{path}: has more than {MAX_BYTES} bytes")
        image = read(path.read_bytes())
    except OSError as error:
        raise BundleContainerError(f"{path}: {error.strerror or error}") from error
    if trusted is not None and image.signer != trusted:
        signer = "unsigned" if image.signer is None else f"signed by key {image.signer.fingerprint}"
        raise BundleSignerError(f"{path}: {signer}, must be signed by key {trusted.fingerprint}")
    check_numbers(image.payload, image.facts.layout)
    return image


def described(image: ControllerImage) -> dict[str, str]:
    """The facts by name, in the order in which they are shown."""
    facts, layout = image.facts, layout_in(image.payload, image.facts.layout)
    width, speed, density = facts.operating_point
    return {
        "name": facts.name,
        "signer": "unsigned" if image.signer is None else image.signer.fingerprint,
        "digest": image.digest,
        "security version": str(facts.security_version),
        "hardware": facts.hardware or "any",
        "precision": layout.get("SW_PRECISION", "").strip('"'),
        "sensors": layout.get("SW_SENSOR_NAMES", "").strip('"').replace(" ", ", "),
        "limit": f"|a| <= {facts.action_limit:g} U_inf W",
        "operating point": f"W {width:g} m, U_inf {speed:g} m/s, rho {density:g} kg/m3",
        "control period": f"{facts.period_ns / 1e6:g} ms",
        "layout": facts.layout.hex(),
        "DBC SHA-256": facts.dbc.hex(),
        "payload": f"{len(image.payload)} bytes",
    }


def compared(image: ControllerImage) -> dict[str, str]:
    """The facts, every setting of the layout, and every array, by names: what two images may differ in."""
    layout = layout_in(image.payload, image.facts.layout)
    arrays = {
        f"array {name}": " ".join(map(str, values.ravel().tolist()))
        if values.size <= _FEW
        else f"{values.dtype} {'x'.join(map(str, values.shape))}, {sha256(np.ascontiguousarray(values).tobytes())[:16]}"
        for name, values in arrays_in(image.payload, layout).items()
    }
    settings = {name: value for name, value in layout.items() if not name.endswith("_LAYOUT")}
    return {**described(image), **settings, **arrays}
