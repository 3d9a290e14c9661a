"""What a run was made with: controller, plant, settings and versions."""

import platform
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from importlib.metadata import version
from typing import Any, Final

from can_bridge.wire.messages import EcuStatus, Mode, Reason
from contract.config import loading
from contract.config.controller import MpcConfig
from contract.config.tree import Config
from contract.release.bundle import Bundle

_PACKAGES: Final = ("stillwake", "onnxruntime", "numpy", "numba", "python-can")
"""Their versions decide what a run computes."""


@dataclass(frozen=True, kw_only=True)
class RunMetadata:
    """Kept beside the series of a run, and the facts of its results.

    Attributes:
        controller: name, precision and digest of the bundle.
        computed_by: runtime of the control step.
        signer: fingerprint of the key that signed the bundle; None for an unsigned one.
        plant: solver, mesh and time step.
        sensors: names in the order of the Pressure message.
        mpc: settings of the optimiser in the bundle.
        budget_ms: latest answer after a pressure frame.
        settle: t_c after the request for control that the controlled averages leave out.
        status: of the ECU at the end.
        config: the vehicle, bus and ECU.
        versions: Python, machine and packages.
    """

    controller: str
    computed_by: str
    signer: str | None
    plant: str
    sensors: tuple[str, ...]
    mpc: MpcConfig
    budget_ms: float
    settle: float
    status: EcuStatus
    config: Config
    versions: Mapping[str, str]

    @classmethod
    def of(
        cls, bundle: Bundle, config: Config, *, settle: float, status: EcuStatus, plant: str, computed_by: str
    ) -> "RunMetadata":
        """Of a run in this process; arguments as the attributes."""
        manifest = bundle.manifest
        return cls(
            controller=f"{manifest.name} ({manifest.precision}, {bundle.digest[:12]})",
            computed_by=computed_by,
            signer=None if bundle.signer is None else bundle.signer.fingerprint,
            plant=plant,
            sensors=manifest.sensors,
            mpc=manifest.mpc,
            budget_ms=manifest.budget_ms,
            settle=settle,
            status=status,
            config=config,
            versions={
                "python": platform.python_version(),
                "machine": platform.machine(),
                **{name: version(name) for name in _PACKAGES},
            },
        )

    def to_tree(self) -> dict[str, Any]:
        """Nested plain values, accepted back by `from_tree`."""
        return {
            **{item.name: getattr(self, item.name) for item in fields(self)},
            "sensors": list(self.sensors),
            "mpc": asdict(self.mpc),
            "status": {name: int(value) for name, value in asdict(self.status).items()},
            "config": loading.to_tree(self.config),
            "versions": dict(self.versions),
        }

    @classmethod
    def from_tree(cls, tree: Mapping[str, Any]) -> "RunMetadata":
        """Read what `to_tree` wrote.

        Raises:
            KeyError, TypeError, ValueError: for a field that is missing, unknown or makes no sense.
            ConfigError: for settings that this version does not know.
        """
        status = tree["status"]
        typed = {
            "sensors": tuple(tree["sensors"]),
            "mpc": loading.from_tree({"mpc": tree["mpc"]}).mpc,
            "status": EcuStatus(**{**status, "state": Mode(status["state"]), "reason": Reason(status["reason"])}),
            "config": loading.from_tree(tree["config"]),
        }
        return cls(**{**tree, **typed})
