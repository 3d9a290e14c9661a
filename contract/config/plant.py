"""Settings of the flow, its forcing and the second plant.

Not in the paper: `FlowConfig.substeps` and `FlowConfig.refinement`, `ForcingConfig.exploration_time` and the second
plant.
"""

from dataclasses import dataclass
from typing import Annotated

from contract.config.rules import AtLeastOne, Fraction, NonNegative, Positive, Settings
from contract.config.units import FLOW_RATE, FREQUENCY, TIME


@dataclass(frozen=True, kw_only=True)
class FlowConfig(Settings):
    """The plant and its clock (paper, section 2.1)."""

    reynolds: Positive[float] = 500.0
    """U_inf W / nu: the paper's regime, three to four orders of magnitude below a truck on a road."""
    control_period: Annotated[Positive[float], TIME] = 0.2
    substeps: AtLeastOne[int] = 30
    """Time steps of the solver in a control period: dt = 1/150, set by the jets at full amplitude."""
    action_limit: Annotated[Positive[float], FLOW_RATE] = 0.075
    refinement: Positive[float] = 1.0
    """Divides every spacing of the own solver's grid: below 1 it is coarser, and faster. The shipped recording, and so
    the shipped controller, is of 1."""


@dataclass(frozen=True, kw_only=True)
class ForcingConfig(Settings):
    """The open-loop training waveform and the chirp (paper, section 2.1). Frequencies in 1/t_c."""

    base_frequency: Annotated[Positive[float], FREQUENCY] = 0.2
    modulation_cutoff: Annotated[Positive[float], FREQUENCY] = 0.05
    modulation_index: NonNegative[float] = 0.25
    envelope_frequency: Annotated[Positive[float], FREQUENCY] = 0.005
    envelope_depth: Fraction[float] = 0.45
    chirp_start: Annotated[Positive[float], FREQUENCY] = 0.1
    chirp_end: Annotated[Positive[float], FREQUENCY] = 0.4
    extended_chirp_start: Annotated[Positive[float], FREQUENCY] = 0.01
    """The extended chirp reaches past what the training waveform explores (paper, appendix A)."""
    extended_chirp_end: Annotated[Positive[float], FREQUENCY] = 0.8
    exploration_time: Annotated[Positive[float], TIME] = 1.0
    """Correlation time, in t_c, of the noise added to a controller's commands while they are recorded: long enough
    for the wake to answer, a fifth of a shedding cycle."""


@dataclass(frozen=True, kw_only=True)
class OpenFoamConfig(Settings):
    """The second plant's mesh and start. Its time step in a coupled run is `flow`'s."""

    refinement: Positive[float] = 1.0
    """Divides every spacing of the body-fitted mesh; the time step must shrink with it."""
    develop_time: Annotated[Positive[float], TIME] = 50.0
    """Time without jets before a first run, t_c, from the own solver's developed wake."""
    develop_substeps: AtLeastOne[int] = 20
    """Time steps a control period meanwhile."""
