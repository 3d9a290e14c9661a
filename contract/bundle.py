"""The release bundle: what is flashed onto an ECU, as a directory or a zip of it.

`manifest.json` names the sensors, scaling, limits, MPC settings and timing budget the controller was built
for, where it came from, and the SHA-256 of every other file and of the DBC it speaks. Loading verifies all
of it and refuses a mismatch by name. The manifest's own hash guards against accidents, not against an
attacker who can rewrite it: there is no signature yet.

`controller.onnx` computes one control step. Its interface, with L the window, S the sensors and H the horizon:

=========  ========  =====================================================================================
input      shape     meaning
=========  ========  =====================================================================================
window     (L, S+1)  oldest row first; row k is (Cp_k at the manifest's sensors, a_{k-1})
plan       (H,)      the previous step's plan, as it came out; the graph shifts it by one step
free       (H,)      1 where the optimiser may change the shifted plan, 0 where it is committed (delay)
weights    (7,)      cost weights in the order of `CostWeights`; optional, defaults to the manifest's
=========  ========  =====================================================================================

=========  ========  =====================================================================================
output     shape     meaning
=========  ========  =====================================================================================
new_plan   (H,)      optimised actions a_t .. a_{t+H-1}
forces     (H, 2)    predicted (Cd, Cl) at t+1 .. t+H under `new_plan`
terms      (7,)      unweighted cost terms of `new_plan`, in the order of the weights
cost       ()        J of `new_plan`
=========  ========  =====================================================================================
"""

import hashlib
import json
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

import dacite

from contract import sensors as sensor_facts
from contract.atomic import replacing
from contract.config import MpcConfig
from contract.config_loading import as_float
from contract.errors import BundleError, ConfigError
from contract.operating_point import OperatingPoint

SCHEMA: Final = "stillwake-bundle/1"
MANIFEST: Final = "manifest.json"
CONTROLLER: Final = "controller.onnx"
PRECISIONS: Final = ("float32", "int8")


@dataclass(frozen=True, kw_only=True)
class Scaling:
    """Standardisation inside the controller: scaled = (value - mean) / std, per sensor and per force."""

    pressure_mean: tuple[float, ...]
    pressure_std: tuple[float, ...]
    action_std: float
    force_mean: tuple[float, ...]
    force_std: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class Manifest:
    """What the controller in a bundle assumes about the vehicle around it.

    Raises BundleError if the scaling does not fit the sensors or a number makes no sense.

    Attributes:
        name: for people.
        precision: "float32" or "int8" (weights; arithmetic is float32).
        sensors: names in the order of the controller's window and of the Pressure message.
        window: L, control steps of history.
        control_period: in t_c.
        action_limit: bound on |a| the optimiser keeps.
        operating_point: units of the bus.
        mpc: horizon, iterations, learning rate, default weights.
        budget_ms: latest answer after a pressure frame.
        provenance: data set hash, settings, metrics and versions of the training.
    """

    name: str
    precision: str
    sensors: tuple[str, ...]
    window: int
    control_period: float
    action_limit: float
    operating_point: OperatingPoint
    mpc: MpcConfig
    scaling: Scaling
    budget_ms: float
    provenance: Mapping[str, Any]

    def __post_init__(self) -> None:
        for name, values, count in (
            ("pressure_mean", self.scaling.pressure_mean, len(self.sensors)),
            ("pressure_std", self.scaling.pressure_std, len(self.sensors)),
            ("force_mean", self.scaling.force_mean, 2),
            ("force_std", self.scaling.force_std, 2),
        ):
            if len(values) != count:
                raise BundleError(f"scaling.{name} has {len(values)} values: must have {count}")
        deviations = (*self.scaling.pressure_std, self.scaling.action_std, *self.scaling.force_std)
        if not all(value > 0 for value in deviations):
            raise BundleError(f"scaling: standard deviations {deviations} must be positive")
        if self.precision not in PRECISIONS:
            raise BundleError(f"precision {self.precision!r}: must be one of {PRECISIONS}")
        for name in ("window", "control_period", "action_limit", "budget_ms"):
            if not getattr(self, name) > 0:
                raise BundleError(f"{name} = {getattr(self, name)!r}: must be positive")


@dataclass(frozen=True, kw_only=True, eq=False)
class Bundle:
    """A verified bundle. `digest` is the SHA-256 of the manifest; its first 4 bytes go on the bus."""

    manifest: Manifest
    files: Mapping[str, bytes]
    digest: str

    @property
    def short_hash(self) -> int:
        return int(self.digest[:8], 16)


def dbc_bytes() -> bytes:
    """The DBC this version speaks."""
    return files("contract").joinpath("stillwake.dbc").read_bytes()


def dbc_sha256() -> str:
    """Its hash, in hex, as manifests and generated headers hold it."""
    return _sha256(dbc_bytes())


def pack(manifest: Manifest, contents: Mapping[str, bytes]) -> dict[str, bytes]:
    """All files of the bundle, the manifest with its hashes included.

    Raises BundleError for a file name that is a path or the manifest's own.
    """
    for name in contents:
        if name in ("", ".", "..", MANIFEST) or "/" in name or "\\" in name:
            raise BundleError(f"bundle file {name!r}: must be a plain file name other than {MANIFEST}")
    body = {
        "schema": SCHEMA,
        **asdict(manifest),
        "dbc_sha256": dbc_sha256(),
        "files": {name: _sha256(data) for name, data in sorted(contents.items())},
    }
    body["manifest_sha256"] = _manifest_digest(body)
    return {MANIFEST: (json.dumps(body, indent=2, sort_keys=True) + "\n").encode(), **contents}


def write(path: Path, manifest: Manifest, contents: Mapping[str, bytes]) -> None:
    """Write a bundle directory, or a zip if the path ends in .zip; whole or not at all.

    Raises:
        BundleError: for a bad file name, or if the path is a directory with something else in it.
        StillwakeError: if the place cannot be written.
    """
    packed = pack(manifest, contents)
    if path.suffix != ".zip" and path.is_dir() and not (path / MANIFEST).is_file() and any(path.iterdir()):
        # Writing replaces the whole directory.
        raise BundleError(f"bundle {path}: that directory holds something else; name another")
    with replacing(path) as temporary:
        if path.suffix == ".zip":
            with zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as archive:
                for name, data in sorted(packed.items()):
                    # A fixed date keeps equal bundles equal byte for byte.
                    archive.writestr(zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), data)
        else:
            temporary.mkdir()
            for name, data in packed.items():
                (temporary / name).write_bytes(data)


def load(path: Path) -> Bundle:
    """Read and verify a bundle directory or zip.

    Raises:
        BundleError: if anything is missing, added, altered or of another schema; the message names it.
    """
    found = _read_all(path)
    if MANIFEST not in found:
        raise BundleError(f"bundle {path}: {MANIFEST} is missing")
    raw = found.pop(MANIFEST)
    try:
        body = json.loads(raw)
        schema, digest = body.pop("schema"), body.pop("manifest_sha256")
        hashes, dbc = body.pop("files"), body.pop("dbc_sha256")
        if not isinstance(hashes, dict):
            raise TypeError("'files' is not a table")
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise BundleError(f"bundle {path}: {MANIFEST} is damaged ({error})") from error
    if schema != SCHEMA:
        raise BundleError(f"bundle {path}: schema {schema!r}, this version reads {SCHEMA!r}")
    if _manifest_digest({"schema": schema, **body, "files": hashes, "dbc_sha256": dbc}) != digest:
        raise BundleError(f"bundle {path}: {MANIFEST} was altered (its own hash does not match)")
    _verify_files(path, found, hashes)
    if dbc != dbc_sha256():
        raise BundleError(f"bundle {path}: built for another stillwake.dbc")
    return Bundle(manifest=_parse(path, body), files=found, digest=digest)


def _verify_files(path: Path, found: Mapping[str, bytes], hashes: Mapping[str, str]) -> None:
    for name in sorted(hashes.keys() | found.keys()):
        if name not in found:
            raise BundleError(f"bundle {path}: {name} is missing")
        if name not in hashes:
            raise BundleError(f"bundle {path}: {name} is not in the manifest")
        if _sha256(found[name]) != hashes[name]:
            raise BundleError(f"bundle {path}: {name} was altered (SHA-256 does not match the manifest)")
    if CONTROLLER not in found:
        raise BundleError(f"bundle {path}: {CONTROLLER} is missing")


def _parse(path: Path, body: Mapping[str, Any]) -> Manifest:
    try:
        manifest = dacite.from_dict(
            Manifest, body, config=dacite.Config(strict=True, cast=[tuple], type_hooks={float: as_float})
        )
        sensor_facts.indices(manifest.sensors)
    except (dacite.DaciteError, ConfigError, BundleError) as error:
        raise BundleError(f"bundle {path}: {MANIFEST}: {error}") from error
    return manifest


def _read_all(path: Path) -> dict[str, bytes]:
    try:
        if path.is_dir():
            return {item.name: item.read_bytes() for item in path.iterdir()}
        if path.is_file():
            with zipfile.ZipFile(path) as archive:
                return {name: archive.read(name) for name in archive.namelist()}
    except (OSError, zipfile.BadZipFile, zlib.error, EOFError, RuntimeError, ValueError) as error:
        raise BundleError(f"bundle {path}: cannot be read ({error})") from error
    raise BundleError(f"bundle {path}: no such directory or zip")


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _manifest_digest(body: Mapping[str, Any]) -> str:
    return _sha256(json.dumps(body, sort_keys=True, separators=(",", ":")).encode())
