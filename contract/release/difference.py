"""A comparison of two bundles (signer, manifest, files) or two controller images (header, layout, arrays)."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from contract.controller.image_payload import arrays_in, check_numbers, layout_in
from contract.errors import BundleContainerError, BundleSignerError
from contract.printable import shown
from contract.release import bundle as bundles
from contract.release.checks import sha256
from contract.release.container import read_files
from contract.release.controller_image import SUFFIX, ControllerImage, read
from contract.release.manifest import MANIFEST, open_manifest
from contract.release.signing import PublicKey

_MAX_BYTES: Final = 64 * 2**20
_FEW: Final = 8
"""Largest number of values of an array that is shown in full. A larger array is shown by type, shape and hash."""


def is_image(path: Path) -> bool:
    """Return whether the file's name has the suffix of an image."""
    return path.suffix.lower() == SUFFIX


def opened(path: Path, trusted: PublicKey | None = None) -> ControllerImage:
    """Read and check the image in a file. Raises BundleContainerError if the file cannot be read, is damaged, is no
    image, or is an image that no ECU accepts; BundleSignatureError or BundleSignerError for a wrong signature."""
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise BundleContainerError(f"{path}: has more than {_MAX_BYTES} bytes")
        image = read(path.read_bytes())
    except OSError as error:
        raise BundleContainerError(f"{path}: {error.strerror or error}") from error
    if trusted is not None and image.signer != trusted:
        signer = "unsigned" if image.signer is None else f"signed by key {image.signer.fingerprint}"
        raise BundleSignerError(f"{path} is {signer}: must be signed by key {trusted.fingerprint}")
    check_numbers(image.payload, image.facts.layout)
    return image


def described(image: ControllerImage) -> dict[str, str]:
    """Return the data that describe an image, by name, in display order."""
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


def _of_image(image: ControllerImage) -> dict[str, str]:
    layout = layout_in(image.payload, image.facts.layout)
    arrays = {
        f"array {name}": " ".join(map(str, values.ravel().tolist()))
        if values.size <= _FEW
        else f"{values.dtype} {'x'.join(map(str, values.shape))}, {sha256(np.ascontiguousarray(values).tobytes())[:16]}"
        for name, values in arrays_in(image.payload, layout).items()
    }
    settings = {name: value for name, value in layout.items() if not name.endswith("_LAYOUT")}
    return {**described(image), **settings, **arrays}


class Difference(NamedTuple):
    """A value that differs between two bundles or images: its name and two texts; "-" stands for a missing value."""

    name: str
    a: str
    b: str


def differences(a: Path, b: Path) -> list[Difference]:
    """List all differences between two bundles or images; fields of a manifest have dotted names. Raises BundleError as
    `contract.release.bundle.load` does, but accepts bundles for the DBC of another version."""
    rows: list[Difference] = []
    ours, theirs = _facts(a), _facts(b)
    for name in [*ours, *(name for name in theirs if name not in ours)]:
        rows += _compared(name, ours.get(name), theirs.get(name))
    return rows


def _facts(path: Path) -> dict[str, Any]:
    if is_image(path):
        return {**_of_image(opened(path))}
    bundle = bundles.load(path, any_dbc=True)
    manifest = open_manifest(path, read_files(path)[MANIFEST])
    body = dict(manifest.body)
    return {
        "name": body.pop("name"),
        "created": body.pop("created"),
        "digest": bundle.digest,
        "schema": manifest.schema,
        "signer": "unsigned" if bundle.signer is None else bundle.signer.fingerprint,
        "dbc_sha256": manifest.dbc,
        **{name: body[name] for name in sorted(body) if name != "provenance"},
        **{f"file {name}": f"{len(data)} bytes, {sha256(data)}" for name, data in sorted(bundle.files.items())},
        "provenance": body["provenance"],
    }


def _compared(name: str, a: object, b: object) -> Iterator[Difference]:
    """List the differences between two values. Tables, and lists of equal length, are compared entry by entry."""
    if isinstance(a, Mapping) and isinstance(b, Mapping):
        for key in sorted(a.keys() | b.keys()):
            yield from _compared(f"{name}.{key}", a.get(key), b.get(key))
    elif isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        for index, (one, other) in enumerate(zip(a, b, strict=True)):
            yield from _compared(f"{name}[{index}]", one, other)
    elif a != b:
        yield Difference(shown(name), *("-" if value is None else shown(value) for value in (a, b)))
