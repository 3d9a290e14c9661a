"""What a run was made with: controller, plant, settings and versions, and the call that started it."""

import platform
from collections.abc import Iterator, Mapping, Sequence
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

_PACKAGES: Final = ("stillwake", "onnxruntime", "numpy", "numba", "python-can")
"""Their versions decide what a run computes."""


@dataclass(frozen=True, kw_only=True)
class RunOrigin:
    """How a run came about.

    Attributes:
        day: it was made, YYYY-MM-DD.
        command: words of the command line that started it; none for a run that no command line started.
        flow: the state the plant began from.
    """

    day: str
    command: tuple[str, ...] = ()
    flow: str = "the plant's own developed wake"

    @classmethod
    def on(cls, day: date, *, command: tuple[str, ...] = (), start: str | None = None) -> "RunOrigin":
        """Origin of this day; `start` names the state file, if one was given."""
        return cls(day=day.isoformat(), command=command, flow=cls.flow if start is None else start)


@dataclass(frozen=True, kw_only=True)
class InjectedFault:
    """What disturbed a run. `acted` counts how often it did: for a fault of a port what the fault counts, for wire
    errors the disturbed attempts, for the others periods."""

    text: str
    acted: int


@dataclass(frozen=True, kw_only=True)
class RunEcu:
    """Which ECU a run had.

    Attributes:
        kind: python, c or mcu.
        clock_mhz: of an emulated core; None where virtual time is charged by `ecu.compute_time_ms`.
        modelled_ms: median of what that core took for a step with a plan, by the model of its pipeline; None without.
        modelled_ms_max: the longest.
    """

    kind: str = "python"
    clock_mhz: float | None = None
    modelled_ms: float | None = None
    modelled_ms_max: float | None = None

    @classmethod
    def of(cls, kind: str, clock_mhz: float | None, planned_ns: Sequence[int]) -> "RunEcu":
        """Take the compute time of every step that planned."""
        if clock_mhz is None or not planned_ns:
            return cls(kind=kind, clock_mhz=clock_mhz)
        milliseconds = [item / 1e6 for item in planned_ns]
        return cls(kind=kind, clock_mhz=clock_mhz, modelled_ms=median(milliseconds), modelled_ms_max=max(milliseconds))


@dataclass(frozen=True, kw_only=True)
class RunMetadata:
    """Kept with the series of a run, and the facts of its results.

    Attributes:
        controller: name, precision and digest of the bundle.
        digest: of the bundle, in full.
        computed_by: runtime of the control step.
        signer: fingerprint of the key that signed the bundle; None for an unsigned one.
        sensors: names in the order of the Pressure message.
        mpc: settings of the optimiser in the bundle.
        weights: of the cost, as they were in force.
        budget_ms: latest answer after a pressure frame.
        averages: whether averages were asked for.
        settle: t_c after the request for control that the controlled averages leave out.
        faults: what disturbed it, in the order given; nothing in an ordinary run.
        drive: name of the drive that the vehicle was on; None for a run at one speed.
    """

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
        """Metadata of a run in this process. `calibration` is of the ECU that ran: weights and bounds are recorded as
        it had them. `others` are the attributes that do not follow from these."""
        manifest = bundle.manifest
        mpc = replace(manifest.mpc, weights=calibration.weights)
        ran = with_calibration(replace(config, mpc=mpc), calibration)
        return cls(
            controller=f"{manifest.name} ({manifest.precision}, {bundle.digest[:12]})",
            digest=bundle.digest,
            signer=None if bundle.signer is None else bundle.signer.fingerprint,
            sensors=manifest.sensors,
            mpc=manifest.mpc,
            weights=calibration.weights,
            budget_ms=manifest.budget_ms,
            config=ran,
            versions={
                "python": platform.python_version(),
                "machine": platform.machine(),
                **{name: version(name) for name in _PACKAGES},
            },
            **others,
        )

    @property
    def changed_weights(self) -> dict[str, tuple[float, float]]:
        """(in force, the bundle's) of every cost weight that differs from the bundle's, by its name."""
        ours, bundles = asdict(self.weights), asdict(self.mpc.weights)
        return {name: (ours[name], bundles[name]) for name in ours if ours[name] != as_float32(bundles[name])}

    def to_tree(self) -> dict[str, Any]:
        """Nested plain values, accepted back by `from_tree`."""
        status = {name: int(value) for name, value in self.status._asdict().items()}
        return {**asdict(self), "status": status, "versions": dict(self.versions)}

    @classmethod
    def from_tree(cls, tree: Mapping[str, Any]) -> "RunMetadata":
        """Read what `to_tree` wrote. Raises KeyError, TypeError, ConfigError for a field that is missing, unknown or
        makes no sense."""
        config, status = without_retired(tree["config"]), list(EcuStatus(**tree["status"]))
        return typed({**tree, "config": config, "status": status}, cls)


_UNUSED: Final = ("forcing", "model", "train", "mpc")
"""Sections of the settings that a run does not read; the bundle has its own `mpc`."""


def settings_of(run: RunMetadata) -> dict[str, str]:
    """Every setting of a run by its name in TOML with dots, the optimiser's as in the bundle, weights as in force."""
    used = {name: value for name, value in loading.to_tree(run.config).items() if name not in _UNUSED}
    tree = run.to_tree()
    built = tree["mpc"] | {"weights": tree["weights"]}
    return {name: str(value) for name, value in (*leaves(used), *leaves({"mpc": built}))}


def settings_lines(run: RunMetadata) -> list[str]:
    """The settings, then the versions, for a page."""
    return [
        *(f"{name} = {value}" for name, value in settings_of(run).items()),
        *(f"{name} {value}" for name, value in run.versions.items()),
    ]


def leaves(tree: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """(name with dots, value) of every value in nested mappings."""
    for name, value in tree.items():
        if isinstance(value, Mapping):
            yield from leaves(value, f"{above}{name}.")
        else:
            yield f"{above}{name}", value
