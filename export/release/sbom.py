"""Bills of materials in CycloneDX 1.6: of a release bundle, and of a wheel.

    python -m export.release.sbom 2026-11-26 WHEEL...

writes a file next to each wheel, for `make packages`. The same inputs give the same bytes: the day is an argument, and
the serial number is made of what the bill is of. A package's licence is the one that its installation here states.
"""

import sys
import zipfile
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from email import message_from_bytes
from importlib.metadata import PackageNotFoundError, metadata
from pathlib import Path
from typing import Final
from uuid import NAMESPACE_URL, uuid5

from cyclonedx.contrib.license.factories import LicenseFactory
from cyclonedx.model import HashAlgorithm, HashType, Property
from cyclonedx.model.bom import Bom, BomMetaData
from cyclonedx.model.component import Component, ComponentScope, ComponentType
from cyclonedx.output.json import JsonV1Dot6
from packageurl import PackageURL
from packaging.requirements import Requirement

from contract.atomic import replacing
from contract.release.checks import CONTROLLER, Bundle, dbc_sha256, sha256
from contract.release.signing import project_key

SUFFIX: Final = ".cdx.json"
"""Of a bill's file, behind the whole name of what it is of."""
OURS: Final = "MIT"
"""Licence of what the project made; a release of others is theirs."""


def release_bom(bundle: Bundle, contents: Mapping[str, bytes]) -> bytes:
    """A verified release's files, what its controller was trained from, and the software that made it.

    Args:
        contents: all its files by name; `Bundle.files` lacks manifest and signature.
    """
    manifest, licence = bundle.manifest, OURS if bundle.signer == project_key() else None
    about = {
        "digest": bundle.digest,
        "program_sha256": manifest.program_sha256,
        "security_version": str(manifest.security_version),
        "signed_by": "no one" if bundle.signer is None else bundle.signer.fingerprint,
    }
    kind, learned = ComponentType.FIRMWARE, ComponentType.MACHINE_LEARNING_MODEL
    release = _part(kind, manifest.name, version=bundle.digest[:12], licence=licence, about=about)
    hashes = {name: sha256(data) for name, data in sorted(contents.items())}
    files = [_part(learned if name.endswith(".onnx") else ComponentType.FILE, name, hashes[name]) for name in hashes]
    files.append(_part(ComponentType.FILE, "stillwake.dbc", dbc_sha256(), licence=OURS))
    model = _part(learned, "weights", manifest.weights_sha256, licence=licence)
    recording = _part(ComponentType.DATA, "dataset", manifest.dataset_sha256)
    versions: Mapping[str, str] = manifest.provenance.get("versions", {})
    tools = [_package(name, version) for name, version in sorted(versions.items())]
    bom = _bom(release, [*files, model, recording, *tools], bundle.digest, manifest.created)
    bom.register_dependency(release, files)
    bom.register_dependency(next(item for item in files if item.name == CONTROLLER), [model])
    bom.register_dependency(model, [recording, *tools])
    return _json(bom)


def wheel_bom(wheel: Path, day: str) -> bytes:
    """A wheel and the packages that it requires, in the versions that are installed here; those of extras are optional.

    Args:
        day: of the bill, YYYY-MM-DD.
    """
    content = wheel.read_bytes()
    with zipfile.ZipFile(wheel) as archive:
        name = next(item for item in archive.namelist() if item.endswith(".dist-info/METADATA"))
        facts = message_from_bytes(archive.read(name))
    found = _package(facts["Name"], facts["Version"], licence=facts["License-Expression"], digest=sha256(content))
    required: dict[str, ComponentScope] = {}
    for text in facts.get_all("Requires-Dist", []):
        requirement = Requirement(text)
        optional = requirement.marker is not None and "extra" in str(requirement.marker)
        if requirement.name != facts["Name"] and not (optional and requirement.name in required):
            required[requirement.name] = ComponentScope.OPTIONAL if optional else ComponentScope.REQUIRED
    packages = [_package(name, _installed(name, "Version"), scope=scope) for name, scope in sorted(required.items())]
    bom = _bom(found, packages, sha256(content), day)
    bom.register_dependency(found, packages)
    return _json(bom)


def _package(
    name: str,
    version: str | None,
    *,
    licence: str | None = None,
    digest: str | None = None,
    scope: ComponentScope | None = None,
) -> Component:
    if licence is None and _installed(name, "Version") == version:
        licence = _installed(name, "License-Expression")
    kind = ComponentType.PLATFORM if name == "python" else ComponentType.LIBRARY
    purl = PackageURL("generic" if name == "python" else "pypi", name=name, version=version)
    return _part(kind, name, digest, version=version, licence=licence, purl=purl, scope=scope)


def _part(
    kind: ComponentType,
    name: str,
    digest: str | None = None,
    *,
    version: str | None = None,
    licence: str | None = None,
    about: Mapping[str, str] | None = None,
    purl: PackageURL | None = None,
    scope: ComponentScope | None = None,
) -> Component:
    return Component(
        type=kind,
        name=name,
        bom_ref=name,
        version=version,
        hashes=[] if digest is None else [HashType(alg=HashAlgorithm.SHA_256, content=digest)],
        licenses=[] if licence is None else [LicenseFactory().make_from_string(licence)],
        properties=[Property(name=f"stillwake:{key}", value=value) for key, value in (about or {}).items()],
        purl=purl,
        scope=scope,
    )


def _installed(name: str, field: str) -> str | None:
    """What a package that is installed here states about itself."""
    try:
        stated = metadata(name).get_all(field)
    except PackageNotFoundError:
        return None
    return str(stated[0]) if stated else None


def _bom(of: Component, parts: Sequence[Component], digest: str, day: str) -> Bom:
    tool = Component(type=ComponentType.APPLICATION, name="stillwake", version=_installed("stillwake", "Version"))
    at = datetime.fromisoformat(day).replace(tzinfo=UTC)
    about = BomMetaData(component=of, timestamp=at, tools=[])
    about.tools.components.add(tool)
    return Bom(components=parts, serial_number=uuid5(NAMESPACE_URL, digest), metadata=about)


def _json(bom: Bom) -> bytes:
    return f"{JsonV1Dot6(bom).output_as_string(indent=2)}\n".encode()


def write_bom(of: Path, content: bytes) -> Path:
    """Write a bill next to what it is of; raises StillwakeError where that is not possible."""
    path = of.with_name(of.name + SUFFIX)
    with replacing(path) as temporary:
        temporary.write_bytes(content)
    return path


if __name__ == "__main__":
    for path in map(Path, sys.argv[2:]):
        write_bom(path, wheel_bom(path, sys.argv[1]))
