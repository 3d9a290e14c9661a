"""What differs between two bundles, signer, manifest and files, or between two controller images."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

from contract.printable import shown
from contract.release import bundle as bundles
from contract.release import image_contents
from contract.release.checks import sha256
from contract.release.container import read_files
from contract.release.manifest import MANIFEST, open_manifest

MISSING: Final = "-"
"""Stands for what one of the two lacks."""


class Difference(NamedTuple):
    """One thing that differs, and what it is in either bundle."""

    name: str
    a: str
    b: str


def differences(a: Path, b: Path) -> list[Difference]:
    """All of them, manifest fields by dotted names; the bundles may be of other versions' DBCs. Raises BundleError as
    `contract.release.bundle.load` does, but for the DBC."""
    rows = []
    ours, theirs = _facts(a), _facts(b)
    for name in [*ours, *(name for name in theirs if name not in ours)]:
        rows += list(_compared(name, ours.get(name), theirs.get(name)))
    return rows


def _facts(path: Path) -> dict[str, Any]:
    """All that is compared, in the order in which it is shown."""
    if image_contents.is_image(path):
        return {**image_contents.compared(image_contents.opened(path))}
    bundle = bundles.load(path, any_dbc=True)
    opened = open_manifest(path, read_files(path)[MANIFEST])
    body = dict(opened.body)
    return {
        "name": body.pop("name"),
        "created": body.pop("created"),
        "digest": bundle.digest,
        "schema": opened.schema,
        "signer": "unsigned" if bundle.signer is None else bundle.signer.fingerprint,
        "dbc_sha256": opened.dbc,
        **{name: body[name] for name in sorted(body) if name != "provenance"},
        **{f"file {name}": f"{len(data)} bytes, {sha256(data)}" for name, data in sorted(bundle.files.items())},
        "provenance": body["provenance"],
    }


def _compared(name: str, a: object, b: object) -> Iterator[Difference]:
    """Where two values differ, down to the single entries of tables and of lists of one length."""
    if isinstance(a, Mapping) and isinstance(b, Mapping):
        for key in sorted(a.keys() | b.keys()):
            yield from _compared(f"{name}.{key}", a.get(key), b.get(key))
    elif isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        for index, (one, other) in enumerate(zip(a, b, strict=True)):
            yield from _compared(f"{name}[{index}]", one, other)
    elif a != b:
        yield Difference(shown(name), _text(a), _text(b))


def _text(value: object) -> str:
    return MISSING if value is None else shown(value)
