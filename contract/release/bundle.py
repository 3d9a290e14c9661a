"""The release bundle: a directory with all files that are flashed onto an ECU.

`manifest.json` states for which vehicle the controller was made, the controller's origin (data set, weights, program),
and the SHA-256 of every other file and of the DBC. `manifest.sig`, if present, is an Ed25519 signature of the
manifest's bytes (`contract.release.signing`). So the signature also protects the data and the hashes in the manifest.

`controller.onnx` computes one control step (`contract.controller.interface`). `sensors.onnx`, if present, estimates
each pressure from the other pressures for the ECU's sensor check (`contract.controller.estimator`).
"""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from contract.atomic import write_files
from contract.controller.estimator import ESTIMATOR
from contract.errors import BundleError, BundleFileError
from contract.release import signing
from contract.release.checks import SIGNATURE, Bundle, Check, Made, dbc_sha256, read_checked, sha256
from contract.release.container import is_plain_name, read_files
from contract.release.manifest import MANIFEST, Manifest, SensorEstimator, SpeedRange, encode
from contract.release.signing import PublicKey


@dataclass(frozen=True, kw_only=True)
class MadeEstimator:
    """A sensor estimator for a bundle, with the estimator's entries in the manifest."""

    graph: bytes
    figures: SensorEstimator
    provenance: Mapping[str, Any]


def pack(manifest: Manifest, contents: Mapping[str, bytes], key: Ed25519PrivateKey | None = None) -> dict[str, bytes]:
    """Return all files of the bundle, with manifest and signature. Raises BundleFileError for an invalid file name."""
    for name in contents:
        if name in (MANIFEST, SIGNATURE) or not is_plain_name(name):
            raise BundleFileError(f"bundle file {name!r}: must be a plain file name other than {MANIFEST}, {SIGNATURE}")
    hashes = {name: sha256(data) for name, data in sorted(contents.items())}
    packed = {MANIFEST: encode(manifest, hashes, dbc_sha256()), **contents}
    if key is not None:
        packed[SIGNATURE] = signing.sign(key, packed[MANIFEST])
    return packed


def write(path: Path, manifest: Manifest, contents: Mapping[str, bytes], key: Ed25519PrivateKey | None = None) -> None:
    """Write a bundle directory, completely or not at all. Without a key the bundle is unsigned. Raises BundleError for
    a bad file name, or if the directory is neither empty nor a bundle; StillwakeError if writing fails."""
    packed = pack(manifest, contents, key)
    check_replaceable(path)
    write_files(path, packed)


def check_replaceable(path: Path) -> None:
    """Raise BundleError if the directory is neither empty nor a bundle, or if the path ends in .zip."""
    if path.suffix.lower() == ".zip":
        raise BundleError(f"bundle {path}: a bundle is written as a directory; give a name that does not end in .zip")
    if path.is_dir() and not (path / MANIFEST).is_file() and any(path.iterdir()):
        raise BundleError(f"bundle {path}: that directory holds other files; name another directory")


def sign(path: Path, key: Ed25519PrivateKey, judge: Callable[[Bundle], object] | None = None) -> Bundle:
    """Verify a bundle except its signature, call `judge`, and sign the bundle in place. If `judge` raises an error, the
    bundle is not signed. Raises BundleError as `load` does; StillwakeError if the bundle cannot be written."""
    contents = read_files(path)
    contents.pop(SIGNATURE, None)
    bundle = read_checked(path, contents)
    if judge is not None:
        judge(bundle)
    write_files(path, {**contents, SIGNATURE: signing.sign(key, contents[MANIFEST])})
    return replace(bundle, signer=signing.public_key(key))


def with_estimator(manifest: Manifest, contents: dict[str, bytes], made: MadeEstimator) -> Manifest:
    """Add the estimator's graph to `contents`. Returns the manifest with the estimator's figures and provenance."""
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
    speeds: SpeedRange | None = None,
    estimator: MadeEstimator | None = None,
    judge: Callable[[Bundle], object] | None = None,
) -> Bundle:
    """Write a copy of a bundle under another name, for this version's DBC, and sign the copy.

    The old bundle may be for another DBC, but must pass all other checks. The controller is copied unchanged, because
    its inputs and outputs are Cp and flow rates in U_inf W, and do not depend on frames, Pa or m/s. The control period
    in s and the budget follow from the operating point. Raises BundleError as `load` does, and for a bad name or a
    target that is neither empty nor a bundle; StillwakeError if writing fails.

    Args:
        created, trusted: day of the new bundle, YYYY-MM-DD; the key that must have signed the old bundle (`load`).
        operating_point: new width, speed or density, by name; other values come from the old bundle.
        weights: new weights of the cost, by name; other weights come from the old bundle.
        security_version, hardware: new values; None uses the old bundle's value.
        speeds: part of the old bundle's speed range; the ECU shuts the jets outside this part.
        estimator: new sensor estimator; None uses the old bundle's estimator, if there is one.
        judge: function that is called with the new bundle before the bundle is written, as in `sign`.
    """
    old = read_checked(path, read_files(path), trusted, any_dbc=True)
    provenance = {**old.manifest.provenance, "renewed_from": old.digest}
    manifest, contents = replace(old.manifest, name=name, created=created, provenance=provenance), dict(old.files)
    check_replaceable(target)
    if operating_point:
        point = replace(manifest.operating_point, **operating_point)
        manifest = replace(manifest, operating_point=point, budget_ms=point.period_ns(manifest.control_period) / 1e6)
    if weights:
        manifest = replace(manifest, mpc=replace(manifest.mpc, weights=replace(manifest.mpc.weights, **weights)))
    if speeds is not None:
        served = manifest.speeds
        if served is None or not served.slowest <= speeds.slowest <= speeds.fastest <= served.fastest:
            whole = "no range of speeds" if served is None else f"{served.slowest:g}:{served.fastest:g}"
            raise BundleError(f"speeds {speeds.slowest:g}:{speeds.fastest:g}: the old bundle serves {whole}")
    changed: dict[str, Any] = {"security_version": security_version, "hardware": hardware, "speeds": speeds}
    manifest = replace(manifest, **{name: value for name, value in changed.items() if value is not None})
    if estimator is not None:
        manifest = with_estimator(manifest, contents, estimator)
    if judge is not None:
        judge(replace(old, manifest=manifest, files=contents))
    write(target, manifest, contents, key)
    return load(target, signing.public_key(key))


def load(path: Path, trusted: PublicKey | None = None, *, any_dbc: bool = False) -> Bundle:
    """Read and verify a bundle directory, which the trusted key must have signed. If no key is given, an unsigned
    bundle passes, as does a bundle with a valid signature by any key (`Bundle.signer`). `any_dbc` also reads a bundle
    for another version's DBC. Raises BundleError if a file is missing, added, altered, of another schema or not signed
    as required. The message states the file; each kind of fault has a separate subclass of the error."""
    return read_checked(path, read_files(path), trusted, any_dbc=any_dbc)


def examine(path: Path, trusted: PublicKey | None = None) -> list[Check]:
    """Make the checks of `load` in order and return the results. Checks that depend on a failed check are left out."""
    try:
        contents = read_files(path)
    except BundleError as error:
        return [Check(name="container", error=error)]
    made = Made(lists=True)
    made.checks.append(Check(name="container", found=f"directory of {len(contents)} files"))
    with suppress(BundleError):
        read_checked(path, contents, trusted, made)
    return made.checks
