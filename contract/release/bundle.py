"""The release bundle: what is flashed onto an ECU, as a directory.

`manifest.json` names the sensors, scaling, limits, MPC settings and timing budget the controller was built for, the
data set, weights and program it comes from, and the SHA-256 of every other file and of its DBC.
`manifest.sig`, where there is one, is an Ed25519 signature of the manifest's bytes (`contract.release.signing`), and so
of all that. Loading verifies everything and refuses a mismatch by name. The manifest's own hash guards against
accidents; a signature by a key that the reader trusts guards against people.

`controller.onnx` computes one control step, with the inputs and outputs of `contract.controller.interface`; its bytes
are judged whenever it is loaded (`contract.release.onnx_graph`). So are those of `sensors.onnx`, where there is one: it
estimates the pressures from each other, for the ECU's sensor check (`contract.controller.estimator`).
"""

from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from contract.controller.estimator import ESTIMATOR
from contract.errors import BundleError, BundleFileError
from contract.release import signing
from contract.release.checks import SIGNATURE, Bundle, Check, Made, dbc_sha256, read_checked, sha256
from contract.release.container import is_plain_name, read_files, write_files
from contract.release.manifest import MANIFEST, Manifest, SensorEstimator, SpeedRange, encode
from contract.release.signing import PublicKey


@dataclass(frozen=True, kw_only=True)
class MadeEstimator:
    """A sensor estimator for a bundle. `figures` is what the manifest holds of it."""

    graph: bytes
    figures: SensorEstimator
    provenance: Mapping[str, Any]


def pack(manifest: Manifest, contents: Mapping[str, bytes], key: Ed25519PrivateKey | None = None) -> dict[str, bytes]:
    """All files of the bundle, the manifest with its hashes and, given a key, its signature included. Raises
    BundleFileError for a file name that is a path or taken."""
    for name in contents:
        if name in (MANIFEST, SIGNATURE) or not is_plain_name(name):
            raise BundleFileError(f"bundle file {name!r}: must be a plain file name other than {MANIFEST}, {SIGNATURE}")
    hashes = {name: sha256(data) for name, data in sorted(contents.items())}
    packed = {MANIFEST: encode(manifest, hashes, dbc_sha256()), **contents}
    if key is not None:
        packed[SIGNATURE] = signing.sign(key, packed[MANIFEST])
    return packed


def write(path: Path, manifest: Manifest, contents: Mapping[str, bytes], key: Ed25519PrivateKey | None = None) -> None:
    """Write a bundle directory, whole or not at all; unsigned without a key. Raises BundleError for a bad file name, or
    if the path is a directory with something else in it; StillwakeError if the place cannot be written."""
    packed = pack(manifest, contents, key)
    check_replaceable(path)
    write_files(path, packed)


def check_replaceable(path: Path) -> None:
    """Raises BundleError if writing a bundle, which replaces a whole directory, would replace something else."""
    if path.suffix.lower() == ".zip":
        raise BundleError(f"bundle {path}: is written as a directory; name one that does not end in .zip")
    if path.is_dir() and not (path / MANIFEST).is_file() and any(path.iterdir()):
        raise BundleError(f"bundle {path}: that directory holds something else; name another")


def sign(path: Path, key: Ed25519PrivateKey, judge: Callable[[Bundle], object] | None = None) -> Bundle:
    """Verify all of a bundle but its signature, and sign it in place. Raises BundleError as `load` does; StillwakeError
    if it cannot be written. `judge` is called with the bundle before that; it raises for one that must not be."""
    contents = read_files(path)
    contents.pop(SIGNATURE, None)
    bundle = read_checked(path, contents)
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
    speeds: SpeedRange | None = None,
    estimator: MadeEstimator | None = None,
    judge: Callable[[Bundle], object] | None = None,
) -> Bundle:
    """Write a bundle of another version's DBC again, with this version's, under another name, and sign it.

    Or of another operating point: the controller knows Cp and U_inf W, not Pa and m/s; the control period, and with it
    the budget, follow.

    Everything else about the old bundle must be in order. Its controller is kept to the byte; the new manifest's
    provenance names the old one's hash. A controller knows pressures and flow rates, not frames, so a change of the DBC
    leaves it as good as it was. Raises BundleError as `load` does, and for a bad name or a target that holds something
    else; StillwakeError if it cannot be written.

    Args:
        created: day, YYYY-MM-DD.
        trusted: the key that must have signed the old bundle, as in `load`.
        operating_point: width, speed or density in place of the old bundle's, by name.
        weights: of the cost, in place of the old bundle's, by name.
        security_version, hardware: in place of the old bundle's.
        speeds: part of the old bundle's range, outside of which the ECU is to shut the jets.
        estimator: a sensor estimator; without it, one that is there is kept.
        judge: called with the new bundle before it is written, as in `sign`.
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
    served = None if speeds is None else _within(speeds, manifest.speeds)
    changed: dict[str, Any] = {"security_version": security_version, "hardware": hardware, "speeds": served}
    manifest = replace(manifest, **{name: value for name, value in changed.items() if value is not None})
    if estimator is not None:
        manifest = with_estimator(manifest, contents, estimator)
    if judge is not None:
        judge(replace(old, manifest=manifest, files=contents))
    write(target, manifest, contents, key)
    return load(target, signing.public_key(key))


def _within(speeds: SpeedRange, old: SpeedRange | None) -> SpeedRange:
    if old is None or not old.slowest <= speeds.slowest <= speeds.fastest <= old.fastest:
        whole = "no range of speeds" if old is None else f"{old.slowest:g}:{old.fastest:g}"
        raise BundleError(f"speeds {speeds.slowest:g}:{speeds.fastest:g}: the old bundle serves {whole}")
    return speeds


def load(path: Path, trusted: PublicKey | None = None, *, any_dbc: bool = False) -> Bundle:
    """Read and verify a bundle directory. Raises BundleError if anything is missing, added, altered, of another
    schema or not signed as demanded; the message names it, and the subclass is of its kind.

    Args:
        trusted: the key that must have signed it. Without one an unsigned bundle passes, and so does any key's good
            signature; `Bundle.signer` names it.
        any_dbc: also read a bundle for another version's DBC.
    """
    return read_checked(path, read_files(path), trusted, any_dbc=any_dbc)


def verified(name: str, contents: Mapping[str, bytes], trusted: Collection[PublicKey]) -> Bundle:
    """The bundle of files that are in memory, every check of `load` made. Raises BundleError as `load`. One of the keys
    in `trusted` must have signed it."""
    return read_checked(Path(name), contents, frozenset(trusted))


def examine(path: Path, trusted: PublicKey | None = None) -> list[Check]:
    """Every check that `load` makes, in the same order, the failed ones with their errors.

    Where a check cannot be made because an earlier one failed, the list ends.
    """
    try:
        contents = read_files(path)
    except BundleError as error:
        return [Check(name="container", error=error)]
    made = Made(lists=True)
    made.checks.append(Check(name="container", found=f"directory of {len(contents)} files"))
    with suppress(BundleError):
        read_checked(path, contents, trusted, made)
    return made.checks
