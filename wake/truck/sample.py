"""What a plant shows at one instant; kept apart from the plant, whose kernels take seconds to load."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Sample:
    """What the plant shows at one instant; forces per unit of rho U_inf^2 W / 2.

    Attributes:
        t: time in t_c.
        Cp: at the 90 sensors, relative to the outlet.
        Cd, Cl: wall force without the slot faces.
        Cd_slot_pressure, Cd_slot_viscous: pressure and viscous force on the slot faces.
        Cd_momentum: reaction to the momentum the jets carry, negative for thrust.
        jet_power: power the jets hand to the flow, per unit of rho U_inf^3 W / 2.
        Uy_probe: transverse velocity at (10, 0).
        action: jet flow rate in force at this instant.
    """

    t: float
    Cp: Array
    Cd: float
    Cl: float
    Cd_slot_pressure: float
    Cd_slot_viscous: float
    Cd_momentum: float
    jet_power: float
    Uy_probe: float
    action: float

    @property
    def Cd_slot(self) -> float:
        """Force on the slot faces."""
        return self.Cd_slot_pressure + self.Cd_slot_viscous

    @property
    def Cd_net(self) -> float:
        """Wall, slot and momentum together: what the vehicle's axle would feel."""
        return self.Cd + self.Cd_slot + self.Cd_momentum
