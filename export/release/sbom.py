"""The bills of materials in CycloneDX 1.6 for a release bundle, for the folder of its C library, and for a wheel.

    python -m export.release.sbom 2026-11-26 WHEEL...

This command writes a file next to each wheel, for `make packages`. Equal inputs give equal bytes: the day is an
argument, and the serial number is computed from the content.
"""

import re
import sys
import zipfile
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from email import message_from_bytes
from importlib.metadata import PackageNotFoundError, metadata
from pathlib import Path
from typing import Any, Final
from uuid import NAMESPACE_URL, uuid5

from cyclonedx.contrib.license.factories import LicenseFactory
from cyclonedx.model import HashAlgorithm, HashType, Property
from cyclonedx.model.bom import Bom, BomMetaData
from cyclonedx.model.component import Component, ComponentScope, ComponentType
from cyclonedx.output.json import JsonV1Dot6
from packageurl import PackageURL
from packaging.requirements import Requirement

from contract.atomic import replacing
from contract.errors import BundleError
from contract.release.checks import CONTROLLER, Bundle, dbc_sha256, sha256
from contract.release.signing import project_key

_MONOCYPHER: Final = re.compile(rb"Monocypher version ([0-9.]+)")
OURS: Final = "MIT"
"""Licence of the project's files and releases; it does not apply to other people's releases."""


def release_bom(bundle: Bundle, contents: Mapping[str, bytes]) -> bytes:
    """Return the bill of a verified release: its files, its controller's training data, and the software used.
    `contents` has all files by name, also manifest and signature. Raises BundleError if a version is not a text."""
    manifest, licence, release = bundle.manifest, _licence(bundle), _release(bundle)
    learned, file = ComponentType.MACHINE_LEARNING_MODEL, ComponentType.FILE
    hashes = {name: sha256(data) for name, data in sorted(contents.items())}
    files = [_part(learned if name.endswith(".onnx") else file, name, digest) for name, digest in hashes.items()]
    files.append(_part(file, "stillwake.dbc", dbc_sha256(), OURS))
    model = _part(learned, "weights", manifest.weights_sha256, licence)
    recording = _part(ComponentType.DATA, "dataset", manifest.dataset_sha256)
    versions = manifest.provenance.get("versions", {})
    if not isinstance(versions, Mapping) or not all(name and isinstance(text, str) for name, text in versions.items()):
        raise BundleError(f"bundle {manifest.name!r}: provenance.versions must be a table of names and texts")
    origin = [recording, *(_package(name, version) for name, version in sorted(versions.items()))]
    controller = next(item for item in files if item.name == CONTROLLER)
    needs = [(release, files), (controller, [model]), (model, origin)]
    return _bom([*files, model, *origin], needs, bundle.digest, manifest.created)


def folder_bom(contents: Mapping[str, bytes], bundle: Bundle) -> bytes:
    """Return the bill of a C library's folder: its files by their paths, the release, and third-party code."""
    hashes = {name: sha256(data) for name, data in sorted(contents.items())}
    digest, name = sha256(repr(hashes).encode()), f"{bundle.manifest.name} in C"
    folder = _part(ComponentType.FIRMWARE, name, licence=_licence(bundle), version=digest[:12])
    files = [_part(ComponentType.FILE, path, digest) for path, digest in hashes.items()]
    foreign = [file for file in files if "/monocypher" in file.name]
    own = [_release(bundle), *(file for file in files if file not in foreign)]
    needs = [(folder, own)]
    if foreign:
        version = _MONOCYPHER.findall(b"".join(contents[file.name] for file in foreign))[0].decode()
        where, licence = PackageURL("github", "LoupVaillant", "Monocypher", version), "BSD-2-Clause OR CC0-1.0"
        monocypher = _part(ComponentType.LIBRARY, "monocypher", licence=licence, version=version, purl=where)
        needs = [(folder, [*own, monocypher]), (monocypher, foreign)]
    return _bom([part for _, others in needs for part in others], needs, digest, bundle.manifest.created)


def wheel_bom(wheel: Path, day: str) -> bytes:
    """Return the bill of a wheel; `day` is YYYY-MM-DD. The bill has the wheel and the packages that it needs, in the
    versions installed on this machine. Packages that only extras need are marked as optional."""
    digest = sha256(wheel.read_bytes())
    with zipfile.ZipFile(wheel) as archive:
        name = next(item for item in archive.namelist() if item.endswith(".dist-info/METADATA"))
        facts = message_from_bytes(archive.read(name))
    found = _package(facts["Name"], facts["Version"], digest, facts["License-Expression"])
    scopes: dict[str, ComponentScope] = {}
    for requirement in map(Requirement, facts.get_all("Requires-Dist", [])):
        if "extra" not in str(requirement.marker):
            scopes[requirement.name] = ComponentScope.REQUIRED
        elif requirement.name != found.name:
            scopes.setdefault(requirement.name, ComponentScope.OPTIONAL)
    packages = [_package(name, _installed(name, "Version"), scope=scope) for name, scope in sorted(scopes.items())]
    return _bom(packages, [(found, packages)], digest, day)


def _licence(bundle: Bundle) -> str | None:
    return OURS if bundle.signer == project_key() else None


def _release(bundle: Bundle) -> Component:
    manifest = bundle.manifest
    about = {
        "digest": bundle.digest,
        "program_sha256": manifest.program_sha256,
        "security_version": str(manifest.security_version),
        "signed_by": "no one" if bundle.signer is None else bundle.signer.fingerprint,
    }
    properties = [Property(name=f"stillwake:{key}", value=value) for key, value in about.items()]
    more: dict[str, Any] = {"licence": _licence(bundle), "version": bundle.digest[:12], "properties": properties}
    # A package or a file may have the release's name, but a reference must be unique.
    return _part(ComponentType.FIRMWARE, manifest.name, ref=f"release {manifest.name}", **more)


def bill_beside(of: Path) -> Path:
    """Return the path of the bill of materials for the file or folder `of`."""
    return of.with_name(f"{of.name}.cdx.json")


def write_bom(of: Path, content: bytes) -> Path:
    """Write a bill of materials next to the file or folder `of`. Raises StillwakeError if it cannot be written."""
    path = bill_beside(of)
    with replacing(path) as temporary:
        temporary.write_bytes(content)
    return path


def _package(
    name: str, version: str | None, digest: str | None = None, licence: str | None = None, **more: Any
) -> Component:
    if licence is None and _installed(name, "Version") == version:
        stated = (_installed(name, field) for field in ("License-Expression", "License", "Classifier"))
        licence = next((text for text in stated if text and "\n" not in text), None)
    kind, registry = (ComponentType.LIBRARY, "pypi") if name != "python" else (ComponentType.PLATFORM, "generic")
    return _part(kind, name, digest, licence, version=version, purl=PackageURL(registry, None, name, version), **more)


def _part(
    kind: ComponentType, name: str, digest: str | None = None, licence: str | None = None, ref: str = "", **more: Any
) -> Component:
    hashes = [] if digest is None else [HashType(alg=HashAlgorithm.SHA_256, content=digest)]
    licences = [] if licence is None else [LicenseFactory().make_from_string(licence)]
    return Component(type=kind, name=name, bom_ref=ref or name, hashes=hashes, licenses=licences, **more)


def _installed(name: str, field: str) -> str | None:
    try:
        stated = metadata(name).get_all(field) or []
    except PackageNotFoundError:
        return None
    if field == "Classifier":
        stated = [text.rpartition(" :: ")[2] for text in stated if text.startswith("License :: OSI Approved :: ")]
    return next(iter(stated), None)


def _bom(
    parts: Sequence[Component], needs: Sequence[tuple[Component, Sequence[Component]]], digest: str, day: str
) -> bytes:
    about = BomMetaData(component=needs[0][0], timestamp=datetime.fromisoformat(day).replace(tzinfo=UTC))
    version = _installed("stillwake", "Version")
    about.tools.components.add(Component(type=ComponentType.APPLICATION, name="stillwake", version=version))
    bom = Bom(components=parts, serial_number=uuid5(NAMESPACE_URL, digest), metadata=about)
    for one, others in needs:
        bom.register_dependency(one, others)
    return f"{JsonV1Dot6(bom).output_as_string(indent=2)}\n".encode()


if __name__ == "__main__":
    for path in map(Path, sys.argv[2:]):
        write_bom(path, wheel_bom(path, sys.argv[1]))
