"""The manifest of a release bundle: what a controller assumes about the vehicle, where it is from, and all hashes."""

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from datetime import date
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple, get_args

import dacite

from contract import sensors as sensor_facts
from contract.config.controller import MpcConfig
from contract.config.loading import as_float, describe_error
from contract.errors import BundleError, BundleManifestError, ConfigError
from contract.operating_point import OperatingPoint

SCHEMA: Final = "stillwake-bundle/2"
MANIFEST: Final = "manifest.json"
Precision = Literal["float32", "int8"]
"""Of the weights; arithmetic is float32 in either `controller.onnx`."""
PRECISIONS: Final[tuple[Precision, ...]] = get_args(Precision)

_SHA256: Final = re.compile("[0-9a-f]{64}")


@dataclass(frozen=True, kw_only=True)
class Scaling:
    """Standardisation inside the controller: scaled = (value - mean) / std, per sensor and per force."""

    pressure_mean: tuple[float, ...]
    pressure_std: tuple[float, ...]
    action_std: float
    force_mean: tuple[float, ...]
    force_std: tuple[float, ...]

    @property
    def window_mean(self) -> tuple[float, ...]:
        """Means of the columns of the controller's window (Cp_k, a_{k-1}), (S+1,): an action is only divided."""
        return (*self.pressure_mean, 0.0)

    @property
    def window_std(self) -> tuple[float, ...]:
        """Standard deviations of the columns of the controller's window, (S+1,)."""
        return (*self.pressure_std, self.action_std)


@dataclass(frozen=True, kw_only=True)
class Manifest:
    """What the controller in a bundle assumes about the vehicle around it.

    Raises BundleManifestError if the scaling does not fit the sensors, or a number, date or hash makes no sense.

    Attributes:
        name: for people.
        created: day of the export, YYYY-MM-DD.
        precision: "float32" or "int8" (weights; arithmetic is float32).
        sensors: names in the order of the controller's window and of the Pressure message.
        window: L, control steps of history.
        control_period: in t_c.
        action_limit: bound on |a| the optimiser keeps.
        operating_point: units of the bus.
        mpc: horizon, iterations, learning rate, default weights.
        budget_ms: latest answer after a pressure frame.
        compute_time_ms: what of it the release's settings allot to the control step.
        dataset_sha256: of the recording that the model was fitted to.
        weights_sha256: of the trained model's tensors.
        program_sha256: of the controller program that `controller.onnx` computes (`export.program.program_hash`); a C
            library of the same program has it in its header.
        provenance: settings, metrics and versions of the training, and what the export's gates measured.
    """

    name: str
    created: str
    precision: Precision
    sensors: tuple[str, ...]
    window: int
    control_period: float
    action_limit: float
    operating_point: OperatingPoint
    mpc: MpcConfig
    scaling: Scaling
    budget_ms: float
    compute_time_ms: float
    dataset_sha256: str
    weights_sha256: str
    program_sha256: str
    provenance: Mapping[str, Any]

    def __post_init__(self) -> None:
        for name, values, count in (
            ("pressure_mean", self.scaling.pressure_mean, len(self.sensors)),
            ("pressure_std", self.scaling.pressure_std, len(self.sensors)),
            ("force_mean", self.scaling.force_mean, 2),
            ("force_std", self.scaling.force_std, 2),
        ):
            if len(values) != count:
                raise BundleManifestError(f"scaling.{name} has {len(values)} values: must have {count}")
        deviations = (*self.scaling.pressure_std, self.scaling.action_std, *self.scaling.force_std)
        if not all(value > 0 for value in deviations):
            raise BundleManifestError(f"scaling: standard deviations {deviations} must be positive")
        if self.precision not in PRECISIONS:
            raise BundleManifestError(f"precision {self.precision!r}: must be one of {PRECISIONS}")
        for name in ("window", "control_period", "action_limit", "budget_ms"):
            if not getattr(self, name) > 0:
                raise BundleManifestError(f"{name} = {getattr(self, name)!r}: must be positive")
        if not 0 <= self.compute_time_ms <= self.budget_ms:
            raise BundleManifestError(
                f"compute_time_ms = {self.compute_time_ms!r}: must be in 0..budget_ms, which is {self.budget_ms!r}"
            )
        for name in ("dataset_sha256", "weights_sha256", "program_sha256"):
            if not _SHA256.fullmatch(getattr(self, name)):
                raise BundleManifestError(f"{name} = {getattr(self, name)!r}: must be a SHA-256 in 64 hex digits")
        try:
            date.fromisoformat(self.created)
        except ValueError as error:
            raise BundleManifestError(f"created = {self.created!r}: must be a date, YYYY-MM-DD") from error


class Opened(NamedTuple):
    """A manifest whose own hash is right, taken apart: its fields, the hash of every file and of the DBC, its hash."""

    body: Mapping[str, Any]
    hashes: Mapping[str, Any]
    dbc: object
    digest: str


def encode(manifest: Manifest, hashes: Mapping[str, str], dbc: str) -> bytes:
    """The file's content, its own hash included."""
    body = {"schema": SCHEMA, **asdict(manifest), "dbc_sha256": dbc, "files": dict(hashes)}
    body["manifest_sha256"] = digest_of(body)
    return (json.dumps(body, indent=2, sort_keys=True) + "\n").encode()


def open_manifest(path: Path, raw: bytes) -> Opened:
    """Take a bundle's manifest apart; raises BundleManifestError if it is damaged, altered or of another schema."""
    try:
        body = json.loads(raw)
        schema, digest = body.pop("schema"), body.pop("manifest_sha256")
        hashes, dbc = body.pop("files"), body.pop("dbc_sha256")
        if not isinstance(hashes, dict):
            raise TypeError("'files' is not a table")
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise BundleManifestError(f"bundle {path}: {MANIFEST} is damaged ({error})") from error
    if schema != SCHEMA:
        raise BundleManifestError(f"bundle {path}: schema {schema!r}, this version reads {SCHEMA!r}")
    if digest_of({"schema": schema, **body, "files": hashes, "dbc_sha256": dbc}) != digest:
        raise BundleManifestError(f"bundle {path}: {MANIFEST} was altered (its own hash does not match)")
    return Opened(body, hashes, dbc, digest)


def parse(path: Path, body: Mapping[str, Any]) -> Manifest:
    """Its fields; raises BundleManifestError for one that is missing, unknown or makes no sense."""
    try:
        manifest = dacite.from_dict(
            Manifest, body, config=dacite.Config(strict=True, cast=[tuple], type_hooks={float: as_float})
        )
        sensor_facts.indices(manifest.sensors)
    except dacite.DaciteError as error:
        raise BundleManifestError(f"bundle {path}: {MANIFEST}: {describe_error(error)}") from error
    except (ConfigError, BundleError) as error:
        raise BundleManifestError(f"bundle {path}: {MANIFEST}: {error}") from error
    return manifest


def digest_of(body: Mapping[str, Any]) -> str:
    """SHA-256 of a manifest's fields without its own hash, in hex."""
    return hashlib.sha256(json.dumps(body, sort_keys=True, separators=(",", ":")).encode()).hexdigest()
