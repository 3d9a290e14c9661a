"""The manifest of a release bundle: the controller's assumptions about the vehicle, its provenance, and all hashes."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from datetime import date
from itertools import pairwise
from math import ceil, isfinite
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple, Self, get_args

import numpy as np

from contract.arrays import Index
from contract.config.controller import MpcConfig
from contract.config.operating_point import OperatingPoint
from contract.controller.air_speed import LAGS, weight_count
from contract.controller.image_payload import LEAST_FIGURE, MOST_FIGURE, MOST_WEIGHT
from contract.controller.interface import Sizes
from contract.errors import BundleManifestError, ConfigError
from contract.printable import MAX_NAME, is_name, quoted, shown
from contract.release import strict_json
from contract.release.container import MAX_FILES, is_plain_name
from contract.release.strict_json import digest_of
from contract.sensor_layout import SensorLayout
from contract.typed import typed

_SCHEMA: Final = "stillwake-bundle/9"
_SCHEMA_8: Final = "stillwake-bundle/8"
"""The schema of 1.0.0, which has no estimate of the air speed. This version reads both schemas."""
FIRST_SECURITY_VERSION: Final = 1
"""Security version of new releases until it is raised, and the smallest version that a flashable ECU accepts."""
LARGEST_SECURITY_VERSION: Final = 2**32 - 1
MANIFEST: Final = "manifest.json"
MAX_STEPS: Final = 10_000
"""Largest window and horizon, in steps: hundreds of times the release's values, but arrays of this size are small."""
MAX_RESTING: Final = 100
"""Largest number of speeds in a table of the wake without jets. The ECU searches these speeds in every period."""
FAST_PERIODS: Final = 4
SLOW_PERIODS: Final = 64
"""Long averaging time of the residuals in the ECU's sensor check, in control periods; `FAST_PERIODS` is the short time.
The short time, a sixth of a shedding cycle, removes most noise of a sensor. The long time, two cycles, shows drifts."""
WeightPrecision = Literal["float32", "int8"]
"""Type of the stored weights. `controller.onnx` calculates in float32 with either type."""
PRECISIONS: Final[tuple[WeightPrecision, ...]] = get_args(WeightPrecision)
_SHA256: Final = re.compile("[0-9a-f]{64}")
_DATE: Final = re.compile("[0-9]{4}-[0-9]{2}-[0-9]{2}")
"""Accepted form of dates; `date.fromisoformat` would also accept other forms, such as week dates."""


@dataclass(frozen=True, kw_only=True)
class Scaling:
    """The controller's standardisation of sensors, action and forces: scaled = (value - mean) / std."""

    pressure_mean: tuple[float, ...]
    pressure_std: tuple[float, ...]
    action_std: float
    force_mean: tuple[float, ...]
    force_std: tuple[float, ...]

    @property
    def window_mean(self) -> tuple[float, ...]:
        """Means of the window's columns (Cp_k, a_{k-1}), (S+1,). The mean of the action is 0."""
        return (*self.pressure_mean, 0.0)

    @property
    def window_std(self) -> tuple[float, ...]:
        """Standard deviations of the window's columns, (S+1,)."""
        return (*self.pressure_std, self.action_std)

    def misfits(self, sensors: int) -> Iterator[tuple[str, int, int]]:
        """Yield name, length and required length of each tuple that does not fit the number of sensors."""
        sizes = {"pressure_mean": sensors, "pressure_std": sensors, "force_mean": 2, "force_std": 2}
        for name, wanted in sizes.items():
            if (found := len(getattr(self, name))) != wanted:
                yield name, found, wanted

    def of_sensors(self, columns: Index) -> Self:
        """Return the scaling of the sensors in the given columns."""
        mean, std = (tuple(np.array(each)[columns].tolist()) for each in (self.pressure_mean, self.pressure_std))
        return replace(self, pressure_mean=mean, pressure_std=std)


@dataclass(frozen=True, kw_only=True)
class SensorEstimator:
    """The typical residuals of `sensors.onnx` with healthy sensors: the root mean square of residuals that are averaged
    over `FAST_PERIODS` or `SLOW_PERIODS`, in Cp, (S, S). Entry (j, i) is for sensor i, estimated without i and j."""

    fast: tuple[tuple[float, ...], ...]
    slow: tuple[tuple[float, ...], ...]


@dataclass(frozen=True, kw_only=True)
class SpeedRange:
    """The range of vehicle speeds that a controller was built for, as ratios to the operating point's speed."""

    slowest: float
    fastest: float


@dataclass(frozen=True, kw_only=True)
class RestingWake:
    """The wake without jets at increasing speeds, as ratios to the design speed: a reference for the ECU's benefit
    check. `base` is the mean pressure of the release's sensors on the base, `swing` the mean magnitude of the
    differences between its mirrored sensors, in Cp."""

    speeds: tuple[float, ...]
    base: tuple[float, ...]
    swing: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class Manifest:
    """The assumptions of a bundle's controller about the vehicle.

    Raises BundleManifestError if the scaling does not fit the sensors, or a number, date or hash is invalid.

    Attributes:
        created: day of the export, YYYY-MM-DD.
        precision: type of the stored weights, "float32" or "int8"; the arithmetic is in float32.
        sensors: names of the sensors, in the order of the controller's window and of the Pressure message.
        window: L, number of past control steps that the controller reads.
        control_period: control period in t_c.
        action_limit: bound on |a| in the optimiser.
        mpc: settings of the controller. The ECU passes the weights in these settings to the controller in every step.
        budget_ms: largest time from a pressure frame to the command.
        compute_time_ms: part of `budget_ms` that the release's settings assign to the control step.
        dataset_sha256: SHA-256 of the recording to which the model was fitted.
        weights_sha256: SHA-256 of the trained model's tensors.
        program_sha256: SHA-256 of the program that `controller.onnx` and a C library of this program compute.
        provenance: settings, metrics and versions of the training, and the results of the export's checks.
        sensor_positions: (x, y) of every sensor in the body's reference length W; None if the positions are not known.
        sensor_estimator: figures of `sensors.onnx`; None without that file.
        security_version: number that is raised when older releases must not be installed again. An ECU that has
            confirmed a release with a greater number refuses this release.
        hardware: name of the ECU hardware to which the release may be flashed; None for any hardware.
        speeds: range of speeds in which the ECU resamples the controller's past; None for the design speed alone.
        resting: wake without jets as a function of the speed; with None, the ECU assumes the same wake at all speeds.
        air_speed: weights of `contract.controller.air_speed`; with None, the ECU uses the speed on the bus.
    """

    name: str
    created: str
    precision: WeightPrecision
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
    sensor_positions: tuple[tuple[float, float], ...] | None = None
    sensor_estimator: SensorEstimator | None = None
    security_version: int = 0
    hardware: str | None = None
    speeds: SpeedRange | None = None
    resting: RestingWake | None = None
    air_speed: tuple[float, ...] | None = None

    @property
    def past(self) -> int:
        """Number of past periods that the window needs; more than its rows if speeds below the design speed occur."""
        slowest = 1.0 if self.speeds is None else self.speeds.slowest
        return self.window if slowest == 1.0 else ceil(self.window / slowest) + 1

    @property
    def sizes(self) -> Sizes:
        return Sizes(window=self.window, sensors=len(self.sensors), horizon=self.mpc.horizon)

    def __post_init__(self) -> None:
        wrong = next(self._wrong(), None)
        if wrong is not None:
            raise BundleManifestError(wrong)

    def _wrong(self) -> Iterator[str]:
        if self.provenance.get("kind") == "linear":
            yield "a linear controller, which only version 1.0.0 accepts: examples/linear_feedback.py exports a new one"
        for what, name in (("name", self.name), ("hardware", self.hardware)):
            if name is not None and not is_name(name):
                yield f"{what} {quoted(name)}: must be 1 to {MAX_NAME} printable characters"
        if not 0 <= self.security_version <= LARGEST_SECURITY_VERSION:
            yield f"security_version = {self.security_version!r}: must be in 0..{LARGEST_SECURITY_VERSION}"
        count, positions, scaling = len(self.sensors), self.sensor_positions, self.scaling
        if positions is not None and len(positions) != count:
            yield f"sensor_positions has {len(positions)} positions: must have {count}"
        places = np.array([(i, 0) for i in range(count)] if positions is None else positions, dtype=np.float64)
        try:
            SensorLayout(names=self.sensors, positions=places, base=np.array([], dtype=np.intp), mirror=None)
        except ConfigError as error:
            yield str(error)
        for name in ("fast", "slow") if self.sensor_estimator is not None else ():
            table = getattr(self.sensor_estimator, name)
            if len(table) != count or any(len(row) != count for row in table):
                yield f"sensor_estimator.{name}: must have {count} rows of {count} values"
            yield from _no_figure(f"sensor_estimator.{name}:", *(value for row in table for value in row))
        speeds = self.speeds
        if speeds is not None and not 0.1 <= speeds.slowest <= 1.0 <= speeds.fastest <= 10.0:
            yield f"speeds = {speeds.slowest!r}..{speeds.fastest!r}: must include 1 and be within 0.1..10"
        if self.resting is not None:
            yield from _unlike_a_wake(self.resting)
        if self.air_speed is not None:
            if count % 2 or self.window <= max(LAGS):
                yield f"air_speed: needs pairs of sensors, and a window of more than {max(LAGS)} rows"
            elif len(self.air_speed) != weight_count(count // 2):
                yield f"air_speed has {len(self.air_speed)} weights: must have {weight_count(count // 2)}"
            for value in self.air_speed:
                if not abs(value) <= MOST_WEIGHT:
                    yield f"air_speed: {value!r} must be in {-MOST_WEIGHT:g}..{MOST_WEIGHT:g}"
        for name, found, wanted in scaling.misfits(count):
            yield f"scaling.{name} has {found} values: must have {wanted}"
        for value in (*scaling.pressure_mean, *scaling.force_mean):
            if not isfinite(value):
                yield f"scaling: mean {value!r} must be finite"
        deviations = (*scaling.pressure_std, scaling.action_std, *scaling.force_std)
        yield from _not_positive("scaling: standard deviation", *deviations)
        for name in ("control_period", "action_limit", "budget_ms"):
            yield from _not_positive(f"{name} =", getattr(self, name))
        for name, steps in (("window", self.window), ("mpc.horizon", self.mpc.horizon)):
            if not 0 < steps <= MAX_STEPS:
                yield f"{name} = {steps!r}: must be positive and at most {MAX_STEPS}"
        if not 0 <= self.compute_time_ms <= self.budget_ms:
            yield f"compute_time_ms = {self.compute_time_ms!r}: must be in 0..budget_ms, which is {self.budget_ms!r}"
        for name in ("dataset_sha256", "weights_sha256", "program_sha256"):
            if not is_sha256(getattr(self, name)):
                yield f"{name} = {quoted(getattr(self, name))}: must be a SHA-256 in 64 hex digits"
        try:
            is_date = bool(_DATE.fullmatch(self.created) and date.fromisoformat(self.created))
        except ValueError:
            is_date = False
        if not is_date:
            yield f"created = {quoted(self.created)}: must be a date, YYYY-MM-DD"


def _not_positive(what: str, *values: float) -> Iterator[str]:
    for value in values:
        if not (value > 0 and isfinite(value)):
            yield f"{what} {value!r}: must be positive and finite"


def _no_figure(what: str, *values: float) -> Iterator[str]:
    for value in values:
        if not LEAST_FIGURE <= value <= MOST_FIGURE:
            yield f"{what} {value!r}: must be positive, in {LEAST_FIGURE:g}..{MOST_FIGURE:g} Cp"


def _unlike_a_wake(resting: RestingWake) -> Iterator[str]:
    count = len(resting.speeds)
    for name in ("base", "swing"):
        if len(getattr(resting, name)) != count or not 0 < count <= MAX_RESTING:
            yield f"resting.{name}: must have a value for each of 1 to {MAX_RESTING} speeds"
    yield from _not_positive("resting.speeds:", *resting.speeds)
    if any(after <= before for before, after in pairwise(resting.speeds)):
        yield f"resting.speeds = {resting.speeds!r}: must increase"
    yield from _no_figure("resting.swing:", *resting.swing)
    yield from _no_figure("resting.base: a wake has suction, but -base =", *(-value for value in resting.base))


class Opened(NamedTuple):
    """The parts of a manifest whose own hash was verified."""

    schema: str
    body: Mapping[str, Any]
    hashes: Mapping[str, str]
    dbc: object
    digest: str


def is_sha256(value: object) -> bool:
    """Return whether the value is a SHA-256 in hex, as manifests state it."""
    return isinstance(value, str) and _SHA256.fullmatch(value) is not None


def encode(manifest: Manifest, hashes: Mapping[str, str], dbc: str) -> bytes:
    """Return the manifest file's content. Raises BundleManifestError for a provenance that JSON cannot express."""
    body = {"schema": _SCHEMA, **asdict(manifest), "dbc_sha256": dbc, "files": dict(hashes)}
    try:
        body["manifest_sha256"] = digest_of(body)
        return strict_json.encode(body)
    except (TypeError, ValueError, RecursionError) as error:
        raise BundleManifestError(f"{MANIFEST}: cannot be written ({shown(error)})") from error


def open_manifest(path: Path, raw: bytes) -> Opened:
    """Split a manifest into its parts. Raises BundleManifestError for damage, an alteration, or another schema."""
    try:
        body = strict_json.decode(raw)
        schema, digest = body.pop("schema"), body.pop("manifest_sha256")
        hashes, dbc = body.pop("files"), body.pop("dbc_sha256")
        if not isinstance(hashes, dict):
            raise TypeError("'files' is not a table")
        if not isinstance(digest, str):
            raise TypeError("'manifest_sha256' is not a text")
        found = digest_of({"schema": schema, **body, "files": hashes, "dbc_sha256": dbc})
    except (ValueError, KeyError, TypeError) as error:
        raise BundleManifestError(f"bundle {path}: {MANIFEST} is damaged ({shown(error)})") from error
    if schema not in (_SCHEMA, _SCHEMA_8):
        remedy = f"this version reads {_SCHEMA!r}: export the model again"
        raise BundleManifestError(f"bundle {path}: has schema {quoted(schema)}; {remedy}")
    if found != digest:
        raise BundleManifestError(f"bundle {path}: {MANIFEST} was altered (its own hash does not match)")
    if schema == _SCHEMA_8:
        body.setdefault("air_speed", None)
    if len(hashes) > MAX_FILES:
        raise BundleManifestError(f"bundle {path}: {MANIFEST}: files has {len(hashes)} entries, more than {MAX_FILES}")
    for name, value in hashes.items():
        if not is_plain_name(name):
            raise BundleManifestError(f"bundle {path}: {MANIFEST}: files: {quoted(name)} must be a plain file name")
        if not is_sha256(value):
            wrong = f"files.{name} = {quoted(value)}: must be a SHA-256 in 64 hex digits"
            raise BundleManifestError(f"bundle {path}: {MANIFEST}: {wrong}")
    return Opened(schema, body, hashes, dbc, digest)


def parse(path: Path, opened: Opened) -> Manifest:
    """Convert the parts of a manifest. Raises BundleManifestError for a missing, unknown or invalid field."""
    try:
        # Every field must be present, because the version that wrote the bundle may have had other defaults.
        return typed(dict(opened.body), Manifest, complete=True)
    except (ConfigError, BundleManifestError) as error:
        raise BundleManifestError(f"bundle {path}: {MANIFEST}: {shown(error)}") from error
