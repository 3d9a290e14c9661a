"""What the paper reports of its own loop under noise and delay (section 3.3 and appendix B).

Only what stands in its text: of noise and of the delays between, it shows pictures without numbers.
"""

from typing import Final

UNCONTROLLED_CD: Final = 1.051
DELAYED_CD: Final = {0: 0.918, 12: 0.950}
"""Mean Cd under control by the actuator's delay in control periods, compensated (appendix B)."""
NOISE: Final = "consistent drag reduction across all tested noise levels"
"""On noise of 10 to 90 % of the global deviation, without figures (appendix B)."""


def reduction_percent(Cd: float) -> float:
    """Reduction of mean drag against the paper's wake without control."""
    return 100.0 * (1.0 - Cd / UNCONTROLLED_CD)
