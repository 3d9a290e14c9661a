"""Settings of the flow, its forcing and the second plant."""

from dataclasses import dataclass
from typing import Annotated, Final

from contract.config.rules import (
    FLOW_RATE,
    FREQUENCY,
    TIME,
    AtLeastOne,
    Fraction,
    NonNegative,
    Positive,
    Settings,
    ours,
    paper,
    within,
)

_MESH: Final = "explanation/mesh-study.md"
_SUBSTEPS: Final = within(1, 10_000, "more take hours a period")
_REFINEMENT: Final = within(0.1, 10, "coarser, no jet is left; finer, a grid has ten million cells")


@dataclass(frozen=True, kw_only=True)
class FlowConfig(Settings, source=paper("section 2.1")):
    """The plant and its clock (paper, section 2.1)."""

    reynolds: Positive[float] = 500.0
    """U_inf W / nu: the paper's regime, three to four orders of magnitude below a truck on a road."""
    control_period: Annotated[Positive[float], TIME] = 0.2
    """Between two samples of the pressures, and between two actions."""
    substeps: Annotated[int, _SUBSTEPS, ours("half the time step changes nothing that matters", page=_MESH)] = 30
    """Time steps of the solver in a control period: dt = 1/150, set by the jets at full amplitude."""
    action_limit: Annotated[Positive[float], FLOW_RATE] = 0.075
    """Largest action, to either side: the jet flow rate at full amplitude."""
    refinement: Annotated[float, _REFINEMENT, ours("the grid of the mesh study", page=_MESH)] = 1.0
    """Divides every spacing of the own solver's grid: below 1 it is coarser, and faster. The shipped recording, and so
    the shipped controller, is of 1."""


@dataclass(frozen=True, kw_only=True)
class ForcingConfig(Settings, source=paper("section 2.1")):
    """The open-loop training waveform and the chirp (paper, section 2.1). Frequencies in 1/t_c."""

    base_frequency: Annotated[Positive[float], FREQUENCY] = 0.2
    """Frequency of the carrier: about the wake's shedding frequency."""
    modulation_cutoff: Annotated[Positive[float], FREQUENCY] = 0.05
    """Cut-off of the low-pass filter on the noise that modulates the carrier's frequency."""
    modulation_index: Annotated[NonNegative[float], FREQUENCY] = 0.25
    """Largest deviation of the carrier's frequency from the base."""
    envelope_frequency: Annotated[Positive[float], FREQUENCY] = 0.005
    """Frequency of the slow sine that modulates the amplitude."""
    envelope_depth: Fraction[float] = 0.45
    """Share of the amplitude that this sine takes away and adds."""
    chirp_start: Annotated[Positive[float], FREQUENCY] = 0.1
    """The chirp of the test episode sweeps from here to `forcing.chirp_end`."""
    chirp_end: Annotated[Positive[float], FREQUENCY] = 0.4
    extended_chirp_start: Annotated[Positive[float], FREQUENCY, paper("appendix A")] = 0.01
    """The extended chirp reaches past what the training waveform explores (paper, appendix A)."""
    extended_chirp_end: Annotated[Positive[float], FREQUENCY, paper("appendix A")] = 0.8
    exploration_time: Annotated[
        Positive[float], TIME, ours("a fifth of a shedding cycle", page="how-to/record-data.md")
    ] = 1.0
    """Correlation time, in t_c, of the noise added to a controller's commands while they are recorded: long enough
    for the wake to answer."""


@dataclass(frozen=True, kw_only=True)
class OpenFoamConfig(Settings, source=ours("the second plant is not the paper's case", page="how-to/use-openfoam.md")):
    """The second plant's mesh and start. Its time step in a coupled run is `flow`'s."""

    refinement: Annotated[float, _REFINEMENT, ours("the mesh of the comparison", page="how-to/use-openfoam.md")] = 1.0
    """Divides every spacing of the body-fitted mesh; the time step must shrink with it."""
    develop_time: Annotated[Positive[float], TIME] = 50.0
    """Time without jets before a first run, t_c, from the own solver's developed wake."""
    develop_substeps: AtLeastOne[int] = 20
    """Time steps a control period meanwhile."""
