"""The description of a run: controller, plant, settings, versions, and the command that started the run."""

import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import date
from importlib.metadata import version
from statistics import median
from typing import Any, Final

from can_bridge.wire.messages import EcuStatus
from contract.config import loading
from contract.config.controller import CostWeights, MpcConfig
from contract.config.loading import without_retired
from contract.config.tree import Config
from contract.controller.calibration import Calibration, as_float32
from contract.release.checks import Bundle
from contract.typed import typed
from ecu.calibrating import with_calibration

_PACKAGES: Final = ("stillwake", "onnxruntime", "numpy", "numba", "python-can")  # their versions affect results
_UNUSED: Final = ("forcing", "model", "train", "mpc")  # sections that a run does not use; `mpc` comes from the bundle


@dataclass(frozen=True, kw_only=True)
class RunOrigin:
    """The date of a run (YYYY-MM-DD), the words of the command line that started it, and the plant's initial state."""

    day: str
    command: tuple[str, ...] = ()
    flow: str = "the plant's own developed wake"

    @classmethod
    def on(cls, day: date, *, command: tuple[str, ...] = (), start: str | None = None) -> "RunOrigin":
        """Return the origin of a run on this day. `start` is the name of the state file, if a file was given."""
        return cls(day=day.isoformat(), command=command, flow=cls.flow if start is None else start)


@dataclass(frozen=True, kw_only=True)
class InjectedFault:
    """A disturbance and how often it acted. `acted` is the number of effects of a port's fault, of transmissions
    with bit errors, of resets, or of periods in which any other disturbance acted."""

    text: str
    acted: int


@dataclass(frozen=True, kw_only=True)
class RunEcu:
    """The ECU of a run; `kind` is python, c or mcu. For an emulated core, `modelled_ms` and `modelled_ms_max` are the
    median and maximum time of a step with a plan. If `clock_mhz` is None, a step takes `ecu.compute_time_ms`."""

    kind: str = "python"
    clock_mhz: float | None = None
    modelled_ms: float | None = None
    modelled_ms_max: float | None = None

    @classmethod
    def of(cls, kind: str, clock_mhz: float | None, planned_ns: Sequence[int]) -> "RunEcu":
        """Create the record from the compute times of all steps in which the controller planned."""
        if clock_mhz is None or not planned_ns:
            return cls(kind=kind, clock_mhz=clock_mhz)
        times_ms = [item / 1e6 for item in planned_ns]
        return cls(kind=kind, clock_mhz=clock_mhz, modelled_ms=median(times_ms), modelled_ms_max=max(times_ms))


@dataclass(frozen=True, kw_only=True)
class RunMetadata:
    """The description of a run, which is stored with its series. `controller` has name, precision and short digest of
    the bundle, `computed_by` the runtime that computes the control step, `signer` the fingerprint of the key that
    signed the bundle, if any. The sensors are in the order of the Pressure message. `mpc` is from the bundle; `weights`
    are those that the ECU used. `budget_ms` is the longest allowed time from a pressure frame to the ECU's command."""

    controller: str
    digest: str
    computed_by: str
    signer: str | None
    plant: str
    sensors: tuple[str, ...]
    mpc: MpcConfig
    weights: CostWeights
    budget_ms: float
    averages: bool
    settle: float
    status: EcuStatus
    config: Config
    origin: RunOrigin
    versions: Mapping[str, str]
    faults: tuple[InjectedFault, ...] = ()
    fault_seed: int = 0
    ecu: RunEcu = RunEcu()
    drive: str | None = None

    @classmethod
    def of(cls, bundle: Bundle, config: Config, *, calibration: Calibration, **others: Any) -> "RunMetadata":
        """Create the metadata of a run in this process. `calibration` is the ECU's calibration after the run."""
        manifest = bundle.manifest
        mpc = replace(manifest.mpc, weights=calibration.weights)
        own = {"python": platform.python_version(), "machine": platform.machine()}
        return cls(
            controller=f"{manifest.name} ({manifest.precision}, {bundle.digest[:12]})",
            digest=bundle.digest,
            signer=None if bundle.signer is None else bundle.signer.fingerprint,
            sensors=manifest.sensors,
            mpc=manifest.mpc,
            weights=calibration.weights,
            budget_ms=manifest.budget_ms,
            config=with_calibration(replace(config, mpc=mpc), calibration),
            versions=own | {name: version(name) for name in _PACKAGES},
            **others,
        )

    @property
    def changed_weights(self) -> dict[str, tuple[float, float]]:
        """Cost weights that the run changed: (value in the run, value in the bundle) by the weight's name."""
        ours, bundles = asdict(self.weights), asdict(self.mpc.weights)
        return {name: (ours[name], bundles[name]) for name in ours if ours[name] != as_float32(bundles[name])}

    def to_tree(self) -> dict[str, Any]:
        """Return the metadata as nested plain values, which `from_tree` accepts."""
        status = {name: int(value) for name, value in self.status._asdict().items()}
        return {**asdict(self), "status": status, "versions": dict(self.versions)}

    @classmethod
    def from_tree(cls, tree: Mapping[str, Any]) -> "RunMetadata":
        """Read the result of `to_tree`. Raises KeyError, TypeError or ConfigError for an invalid field."""
        config, status = without_retired(tree["config"]), list(EcuStatus(**tree["status"]))
        return typed({**tree, "config": config, "status": status}, cls)


def settings_of(run: RunMetadata) -> dict[str, str]:
    """Return a run's settings by their dotted TOML names. The `mpc` settings, except the weights, are the bundle's."""
    used = {name: value for name, value in loading.to_tree(run.config).items() if name not in _UNUSED}
    built = asdict(run.mpc) | {"weights": asdict(run.weights)}
    return {name: str(value) for name, value in loading.leaves(used | {"mpc": built})}
