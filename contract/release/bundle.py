"""The release bundle: what is flashed onto an ECU, as a directory or a zip of it.

`manifest.json` names the sensors, scaling, limits, MPC settings and timing budget the controller was built for, the
data set, weights and program it comes from, and the SHA-256 of every other file and of its DBC.
`manifest.sig`, where there is one, is an Ed25519 signature of the manifest's bytes (`contract.release.signing`), and so
of all that. Loading verifies everything and refuses a mismatch by name. The manifest's own hash guards against
accidents; a signature by a key that the reader trusts guards against people.

`controller.onnx` computes one control step, with the inputs and outputs of `contract.controller.interface`; its bytes
are judged whenever it is loaded (`contract.release.onnx_graph`). So are those of `sensors.onnx`, where there is one: it
estimates the pressures from each other, for the ECU's sensor check (`contract.controller.estimator`).
"""

import hashlib
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any, Final, TypeVar

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from contract.controller.estimator import ESTIMATOR
from contract.errors import (
    BundleControllerError,
    BundleDbcError,
    BundleError,
    BundleFileError,
    BundleManifestError,
    BundleSignatureError,
    BundleSignerError,
)
from contract.release import signing
from contract.release.container import is_plain_name, read_files, write_files
from contract.release.manifest import MANIFEST, Manifest, SensorEstimator, encode, open_manifest, parse
from contract.release.onnx_graph import check_graph
from contract.release.signing import PublicKey

SIGNATURE: Final = "manifest.sig"
CONTROLLER: Final = "controller.onnx"
UNSIGNED: Final = "unsigned: its hashes show accidents, not who made it"

_T = TypeVar("_T")


@dataclass(frozen=True, kw_only=True, eq=False)
class Bundle:
    """A verified bundle.

    Attributes:
        files: all but manifest and signature.
        digest: SHA-256 of the manifest; its first 4 bytes go on the bus. A signature does not change it.
        signer: who signed the manifest, with a signature that is good; None if no one did.
        is_trusted: whether it was loaded with that key as the one to trust.
    """

    manifest: Manifest
    files: Mapping[str, bytes]
    digest: str
    signer: PublicKey | None = None
    is_trusted: bool = False

    @property
    def short_hash(self) -> int:
        return int(self.digest[:8], 16)


@dataclass(frozen=True, kw_only=True)
class MadeEstimator:
    """A sensor estimator for a bundle.

    Attributes:
        graph: the content of `sensors.onnx`.
        figures: what the manifest holds of it.
        provenance: where it is from.
    """

    graph: bytes
    figures: SensorEstimator
    provenance: Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class Check:
    """One thing that was verified about a bundle; `error` is None if it is in order."""

    name: str
    found: str = ""
    error: BundleError | None = None


def dbc_bytes() -> bytes:
    """The DBC of this version."""
    return files("contract").joinpath("stillwake.dbc").read_bytes()


def dbc_sha256() -> str:
    """Its hash, in hex, as manifests and generated headers hold it."""
    return sha256(dbc_bytes())


def pack(manifest: Manifest, contents: Mapping[str, bytes], key: Ed25519PrivateKey | None = None) -> dict[str, bytes]:
    """All files of the bundle, the manifest with its hashes and, given a key, its signature included.

    Raises BundleFileError for a file name that is a path or taken.
    """
    for name in contents:
        if name in (MANIFEST, SIGNATURE) or not is_plain_name(name):
            raise BundleFileError(f"bundle file {name!r}: must be a plain file name other than {MANIFEST}, {SIGNATURE}")
    hashes = {name: sha256(data) for name, data in sorted(contents.items())}
    packed = {MANIFEST: encode(manifest, hashes, dbc_sha256()), **contents}
    if key is not None:
        packed[SIGNATURE] = signing.sign(key, packed[MANIFEST])
    return packed


def write(path: Path, manifest: Manifest, contents: Mapping[str, bytes], key: Ed25519PrivateKey | None = None) -> None:
    """Write a bundle directory, or a zip if the path ends in .zip; whole or not at all; unsigned without a key.

    Raises:
        BundleError: for a bad file name, or if the path is a directory with something else in it.
        StillwakeError: if the place cannot be written.
    """
    packed = pack(manifest, contents, key)
    check_replaceable(path)
    write_files(path, packed)


def check_replaceable(path: Path) -> None:
    """Raises BundleError if writing a bundle, which replaces a whole directory, would replace something else."""
    if path.suffix != ".zip" and path.is_dir() and not (path / MANIFEST).is_file() and any(path.iterdir()):
        raise BundleError(f"bundle {path}: that directory holds something else; name another")


def sign(path: Path, key: Ed25519PrivateKey, judge: Callable[[Bundle], object] | None = None) -> Bundle:
    """Verify all of a bundle but its signature, and sign it in place.

    Args:
        judge: called with the bundle before it is signed; raises for one that must not be.

    Raises:
        BundleError: as `load` does.
        StillwakeError: if it cannot be written.
    """
    contents = read_files(path)
    contents.pop(SIGNATURE, None)
    bundle = _verified(path, contents, None)
    if judge is not None:
        judge(bundle)
    write_files(path, {**contents, SIGNATURE: signing.sign(key, contents[MANIFEST])})
    return replace(bundle, signer=signing.public_key(key))


def with_estimator(manifest: Manifest, contents: dict[str, bytes], made: MadeEstimator) -> Manifest:
    """The manifest of a bundle that has this sensor estimator; its graph is put into the contents."""
    contents[ESTIMATOR] = made.graph
    provenance = {**manifest.provenance, "sensor_estimator": made.provenance}
    return replace(manifest, provenance=provenance, sensor_estimator=made.figures)


def renew(
    path: Path,
    target: Path,
    *,
    name: str,
    created: str,
    key: Ed25519PrivateKey,
    trusted: PublicKey | None = None,
    operating_point: Mapping[str, float] | None = None,
    weights: Mapping[str, float] | None = None,
    security_version: int | None = None,
    hardware: str | None = None,
    estimator: Callable[[Manifest], MadeEstimator] | None = None,
    judge: Callable[[Bundle], object] | None = None,
) -> Bundle:
    """Write a bundle of another version's DBC again, with this version's, under another name, and sign it.

    Or of another operating point: the controller knows Cp and U_inf W, not Pa and m/s; the control period, and with it
    the budget, follow.

    Everything else about the old bundle must be in order. Its controller is kept to the byte; the new manifest's
    provenance names the old one's hash. A controller knows pressures and flow rates, not frames, so a change of the DBC
    leaves it as good as it was.

    Args:
        created: day, YYYY-MM-DD.
        trusted: the key that must have signed the old bundle, as in `load`.
        operating_point: width, speed or density in place of the old bundle's, by name.
        weights: of the cost, in place of the old bundle's, by name.
        security_version, hardware: in place of the old bundle's.
        estimator: called with the old manifest, makes a sensor estimator; without it, one that is there is kept.
        judge: called with the new bundle before it is written, as in `sign`.

    Raises:
        BundleError: as `load` does, and for a bad name or a target that holds something else.
        StillwakeError: if it cannot be written.
    """
    old = _verified(path, read_files(path), trusted, any_dbc=True)
    provenance = {**old.manifest.provenance, "renewed_from": old.digest}
    manifest, contents = replace(old.manifest, name=name, created=created, provenance=provenance), dict(old.files)
    check_replaceable(target)
    if operating_point:
        point = replace(manifest.operating_point, **operating_point)
        manifest = replace(manifest, operating_point=point, budget_ms=point.period_ns(manifest.control_period) / 1e6)
    if weights:
        manifest = replace(manifest, mpc=replace(manifest.mpc, weights=replace(manifest.mpc.weights, **weights)))
    if security_version is not None:
        manifest = replace(manifest, security_version=security_version)
    if hardware is not None:
        manifest = replace(manifest, hardware=hardware)
    if estimator is not None:
        manifest = with_estimator(manifest, contents, estimator(old.manifest))
    if judge is not None:
        judge(replace(old, manifest=manifest, files=contents))
    write(target, manifest, contents, key)
    return load(target, signing.public_key(key))


def load(path: Path, trusted: PublicKey | None = None, *, any_dbc: bool = False) -> Bundle:
    """Read and verify a bundle directory or zip.

    Args:
        trusted: the key that must have signed it. Without one an unsigned bundle passes, and so does any key's good
            signature; `Bundle.signer` names it.
        any_dbc: also read a bundle for another version's DBC.

    Raises:
        BundleError: if anything is missing, added, altered, of another schema or not signed as demanded; the message
            names it, and the subclass is of its kind.
    """
    return _verified(path, read_files(path), trusted, any_dbc=any_dbc)


def verified(name: str, contents: Mapping[str, bytes], trusted: Collection[PublicKey]) -> Bundle:
    """The bundle of files that are in memory, every check of `load` made.

    Args:
        name: for messages.
        contents: all its files.
        trusted: keys, one of which must have signed it.

    Raises:
        BundleError: as `load`.
    """
    return _verified(Path(name), contents, frozenset(trusted))


def examine(path: Path, trusted: PublicKey | None = None) -> list[Check]:
    """Every check that `load` makes, in the same order, the failed ones with their errors.

    Where a check cannot be made because an earlier one failed, the list ends.
    """
    try:
        contents = read_files(path)
    except BundleError as error:
        return [Check(name="container", error=error)]
    made = _Made(lists=True)
    kind = "directory" if path.is_dir() else "zip"
    made.checks.append(Check(name="container", found=f"{kind} of {len(contents)} files"))
    with suppress(BundleError):
        _read(path, contents, trusted, made)
    return made.checks


def _verified(
    path: Path,
    contents: Mapping[str, bytes],
    trusted: PublicKey | frozenset[PublicKey] | None,
    *,
    any_dbc: bool = False,
) -> Bundle:
    return _read(path, contents, trusted, _Made(lists=False), any_dbc=any_dbc)


@dataclass(kw_only=True)
class _Made:
    """The checks of a reading; the first that fails ends it, unless they are to be listed."""

    lists: bool
    checks: list[Check] = field(default_factory=list)

    def check(self, name: str, verify: Callable[[], _T], in_words: Callable[[_T], str] = str) -> _T | None:
        """Make a check that no other one builds on; None where it failed."""
        try:
            value = verify()
        except BundleError as error:
            self.checks.append(Check(name=name, error=error))
            if not self.lists:
                raise
            return None
        self.checks.append(Check(name=name, found=in_words(value)))
        return value

    def need(self, name: str, make: Callable[[], _T]) -> _T:
        """Make what the next checks need; the reading ends where it fails."""
        try:
            return make()
        except BundleError as error:
            self.checks.append(Check(name=name, error=error))
            raise


def _read(
    path: Path,
    contents: Mapping[str, bytes],
    trusted: PublicKey | frozenset[PublicKey] | None,
    made: _Made,
    *,
    any_dbc: bool = False,
) -> Bundle:
    """The bundle of these files, with every check; nothing is parsed before its signature is good."""
    raw, signature, parts = made.need(MANIFEST, lambda: _taken_apart(path, contents))

    def signed_by(key: PublicKey | None) -> str:
        return UNSIGNED if key is None else f"good, by {'the trusted ' if trusted else ''}key {key.fingerprint}"

    signer = made.check(SIGNATURE, lambda: _verify_signature(path, raw, signature, trusted), signed_by)
    opened = made.need(MANIFEST, lambda: open_manifest(path, raw))
    made.check(MANIFEST, lambda: opened.digest)
    # Of the files that are there or should be.
    names = sorted({CONTROLLER} | opened.hashes.keys() | parts.keys())
    sound = {name for name in names if made.check(name, partial(_verify_file, path, name, parts, opened.hashes))}
    if not any_dbc:
        made.check("DBC", lambda: _verify_dbc(path, opened.dbc))
    manifest = made.need("content", lambda: parse(path, opened))
    made.check("content", lambda: manifest.name)
    if CONTROLLER in sound:
        made.check("graph", lambda: _verify_graph(path, CONTROLLER, parts[CONTROLLER]))
    is_stated = manifest.sensor_estimator is not None
    if ESTIMATOR in sound or (is_stated and ESTIMATOR not in names):
        made.check("sensor graph", lambda: _verify_estimator(path, parts, is_stated=is_stated))
    return Bundle(
        manifest=manifest,
        files=parts,
        digest=opened.digest,
        signer=signer,
        is_trusted=trusted is not None,
    )


def _taken_apart(path: Path, found: Mapping[str, bytes]) -> tuple[bytes, bytes | None, dict[str, bytes]]:
    """Manifest, signature and all other files."""
    contents = dict(found)
    raw, signature = contents.pop(MANIFEST, None), contents.pop(SIGNATURE, None)
    if raw is None:
        raise BundleManifestError(f"bundle {path}: {MANIFEST} is missing")
    return raw, signature, contents


def _verify_signature(
    path: Path, raw: bytes, signature: bytes | None, trusted: PublicKey | frozenset[PublicKey] | None
) -> PublicKey | None:
    """Who signed it; `trusted` are the keys of which one must have, or None where none need have."""
    keys = frozenset({trusted}) if isinstance(trusted, PublicKey) else trusted
    allowed = "no key that is trusted" if not keys else " or ".join(sorted(f"key {key.fingerprint}" for key in keys))
    if signature is None:
        if keys is not None:
            raise BundleSignerError(f"bundle {path}: unsigned, must be signed by {allowed}")
        return None
    try:
        signer = signing.signer(signature, raw)
    except ValueError as error:
        raise BundleSignatureError(f"bundle {path}: {SIGNATURE} is damaged ({error})") from error
    if signer is None:
        raise BundleSignatureError(f"bundle {path}: bad signature: {MANIFEST} or {SIGNATURE} was altered")
    if keys is not None and signer not in keys:
        raise BundleSignerError(f"bundle {path}: signed by key {signer.fingerprint}, must be signed by {allowed}")
    return signer


def _verify_file(path: Path, name: str, found: Mapping[str, bytes], hashes: Mapping[str, Any]) -> str:
    if name not in found:
        raise BundleFileError(f"bundle {path}: {name} is missing")
    if name not in hashes:
        raise BundleFileError(f"bundle {path}: {name} is not in the manifest")
    digest = sha256(found[name])
    if digest != hashes[name]:
        raise BundleFileError(f"bundle {path}: {name} was altered (SHA-256 does not match the manifest)")
    return digest


def _verify_dbc(path: Path, dbc: object) -> str:
    if dbc != dbc_sha256():
        raise BundleDbcError(
            f"bundle {path}: built for another stillwake.dbc; `stillwake bundle renew` makes one for this version's"
        )
    return dbc_sha256()


def _verify_graph(path: Path, name: str, content: bytes) -> str:
    try:
        check_graph(content)
    except ValueError as error:
        raise BundleControllerError(f"bundle {path}: {name}: {error}") from error
    return f"{len(content)} bytes, with all constants and ONNX's operators alone"


def _verify_estimator(path: Path, contents: Mapping[str, bytes], *, is_stated: bool) -> str:
    content = contents.get(ESTIMATOR)
    if not is_stated:
        raise BundleFileError(f"bundle {path}: {ESTIMATOR}: {MANIFEST} does not mention it (sensor_estimator)")
    if content is None:
        raise BundleFileError(f"bundle {path}: {ESTIMATOR} is missing: {MANIFEST} has a sensor_estimator")
    return _verify_graph(path, ESTIMATOR, content)


def sha256(data: bytes) -> str:
    """In hex, as manifests hold it."""
    return hashlib.sha256(data).hexdigest()
