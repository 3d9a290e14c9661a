"""From the non-dimensional flow to the engineering units of the bus, and back.

The defaults are a full-size truck on a motorway. The flow behind them stays the paper's two-dimensional
Re = 500: the operating point sets clocks and scales, it does not make the wake a truck's.
"""

from dataclasses import dataclass
from math import isfinite

from contract.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class OperatingPoint:
    """Width W in m, speed U_inf in m/s, density rho in kg/m3."""

    width: float = 2.5
    speed: float = 25.0
    density: float = 1.2

    def __post_init__(self) -> None:
        for field in ("width", "speed", "density"):
            value = getattr(self, field)
            if not (value > 0.0 and isfinite(value)):
                raise ConfigError(f"operating_point.{field} = {value}: must be positive")

    @property
    def convective_time(self) -> float:
        """t_c = W / U_inf in s."""
        return self.width / self.speed

    @property
    def dynamic_pressure(self) -> float:
        """rho U_inf^2 / 2 in Pa."""
        return 0.5 * self.density * self.speed**2

    @property
    def flow_rate_scale(self) -> float:
        """U_inf W in m2/s: jet flow rate per unit span that corresponds to an action of 1."""
        return self.speed * self.width

    def period_ns(self, control_period: float) -> int:
        """A control period given in t_c, as whole nanoseconds."""
        return round(control_period * self.convective_time * 1e9)
