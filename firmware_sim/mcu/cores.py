"""The cores for which libraries can be compiled, and for which execution times are modelled."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, kw_only=True)
class Core:
    """A Cortex-M with the DSP extension and single-precision floating point. The fields are its names for users and for
    the compiler, the clocks for which times are computed, and whether it issues two instructions per cycle."""

    name: str
    cpu: str
    clocks_mhz: tuple[int, ...]
    dual_issue: bool


CORTEX_M7: Final = Core(name="Cortex-M7", cpu="cortex_m7+fp_armv8d16sp", clocks_mhz=(480, 300), dual_issue=True)
CORTEX_M4F: Final = Core(name="Cortex-M4F", cpu="cortex_m4+vfp4d16sp", clocks_mhz=(170,), dual_issue=False)
