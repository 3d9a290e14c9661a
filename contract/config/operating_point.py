"""The scales that convert between dimensionless values of the flow and the engineering units on the bus.

The defaults describe a full-size truck on a motorway. They do not turn the simulated flow at Re = 500 into its wake.
"""

from dataclasses import dataclass
from typing import Annotated

from contract.config.notes import Unit, ours
from contract.config.rules import Settings, within


@dataclass(frozen=True, kw_only=True)
class OperatingPoint(
    Settings, section="operating_point", source=ours("a full-size truck on a motorway", page="architecture.md")
):
    """The operating point: width W, speed U_inf and density rho."""

    width: Annotated[float, within(0.01, 100, "a body on a road or in a tunnel"), Unit("m")] = 2.5
    """W: the reference length."""
    speed: Annotated[float, within(0.01, 1000, "a flow past such a body"), Unit("m/s")] = 25.0
    """U_inf: the reference speed; W / U_inf is the reference time."""
    density: Annotated[
        float, within(0.01, 10_000, "gas or liquid"), Unit("kg/m3"), ours("air at 20 degrees C, at sea level")
    ] = 1.2
    """rho: density of the air, which scales pressures and forces."""

    @property
    def convective_time(self) -> float:
        """Convective time t_c = W / U_inf, in s."""
        return self.width / self.speed

    @property
    def dynamic_pressure(self) -> float:
        """Dynamic pressure of the free stream, rho U_inf^2 / 2, in Pa."""
        return 0.5 * self.density * self.speed**2

    @property
    def flow_rate_scale(self) -> float:
        """Jet flow rate per unit span at an action of 1: U_inf W, in m2/s."""
        return self.speed * self.width

    def period_ns(self, control_period: float) -> int:
        """Convert a control period from t_c to whole nanoseconds."""
        return round(control_period * self.convective_time * 1e9)
