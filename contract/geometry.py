"""The dimensions of the truck and of the domain, in body widths W (paper, section 2.1).

`contract.config.body` describes other bodies in this domain. They have the width 1, and slots like the truck's slots.
The front of a body is at x = 0, its axis of symmetry at y = 0. Velocities are in U_inf, times in t_c = W / U_inf, and
pressures are Cp = (p - p_outlet) / (rho U_inf^2 / 2).
"""

from typing import Final

LENGTH: Final = 7.647
HALF_WIDTH: Final = 0.5
LEADING_EDGE_RADIUS: Final = 0.118
JET_WIDTH: Final = 0.05
"""Width of each slot. The slots are at the two edges of the base, |y| in [0.45, 0.5]."""
DOMAIN_X: Final = (-7.0, 23.0)
DOMAIN_Y: Final = (-7.5, 7.5)
WAKE_PROBE: Final = (10.0, 0.0)
"""Point in the truck's wake at which the paper measures the transverse velocity U_y."""
