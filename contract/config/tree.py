"""The tree of all settings. Lengths are in W, times in t_c, and actions (jet flow rates) in U_inf W.

A default is the paper's number if the paper states a number. Values are checked when they are set, so every existing
`Config` is valid. `contract.config.loading` reads trees from TOML and applies overrides.
"""

from dataclasses import dataclass, field

from contract.config.body import BodyConfig
from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig, RefineConfig, TrainConfig
from contract.config.operating_point import OperatingPoint
from contract.config.plant import FlowConfig, ForcingConfig, OpenFoamConfig
from contract.config.vehicle import BusConfig, EcuConfig, VehicleConfig


@dataclass(frozen=True, kw_only=True)
class Config:
    """The tree of all settings. Its sub-trees have the names of the sections in a TOML file."""

    operating_point: OperatingPoint = field(default_factory=OperatingPoint)
    body: BodyConfig = field(default_factory=BodyConfig)
    flow: FlowConfig = field(default_factory=FlowConfig)
    forcing: ForcingConfig = field(default_factory=ForcingConfig)
    model: ModelConfig = field(default_factory=ModelConfig)
    train: TrainConfig = field(default_factory=TrainConfig)
    refine: RefineConfig = field(default_factory=RefineConfig)
    mpc: MpcConfig = field(default_factory=MpcConfig)
    bus: BusConfig = field(default_factory=BusConfig)
    ecu: EcuConfig = field(default_factory=EcuConfig)
    vehicle: VehicleConfig = field(default_factory=VehicleConfig)
    openfoam: OpenFoamConfig = field(default_factory=OpenFoamConfig)

    @property
    def period_ns(self) -> int:
        """Control period in ns at the operating point; the latency budget of a control step has this length."""
        return self.operating_point.period_ns(self.flow.control_period)
