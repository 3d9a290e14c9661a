"""The settings of the flow, of its forcing, and of the second plant (OpenFOAM)."""

from dataclasses import dataclass
from typing import Annotated, Final

from contract.config.notes import FLOW_RATE, FREQUENCY, TIME, ours, paper
from contract.config.rules import AtLeastOne, Fraction, NonNegative, Positive, Settings, within

_MESH: Final = "explanation/mesh-study.md"
_SUBSTEPS: Final = within(1, 10_000, "with more, a period takes hours")
_REFINEMENT: Final = within(0.1, 10, "a coarser grid does not resolve the jets, a finer grid has ten million cells")


@dataclass(frozen=True, kw_only=True)
class FlowConfig(Settings, source=paper("section 2.1")):
    """The Reynolds number, control period, jets and grid of the simulated flow (paper, section 2.1)."""

    reynolds: Positive[float] = 500.0
    """Reynolds number U_inf W / nu. The paper's value is three to four orders of magnitude below a truck's value."""
    control_period: Annotated[Positive[float], TIME] = 0.2
    """Time from one sample of the pressures to the next, and from one action to the next."""
    substeps: Annotated[int, _SUBSTEPS, ours("half the time step changes no result noticeably", page=_MESH)] = 30
    """Number of the solver's time steps per control period. The default gives dt = 1/150 t_c, which the jets at full
    amplitude require."""
    action_limit: Annotated[Positive[float], FLOW_RATE] = 0.075
    """Largest magnitude of the action: the jet flow rate at full amplitude."""
    refinement: Annotated[float, _REFINEMENT, ours("the grid of the mesh study", page=_MESH)] = 1.0
    """Divisor of all grid spacings of the project's own solver; a value below 1 makes the grid coarser and the solver
    faster. The shipped recording and controller were computed with 1."""


@dataclass(frozen=True, kw_only=True)
class ForcingConfig(Settings, source=paper("section 2.1")):
    """The open-loop waveform for training, and the chirp for tests (paper, section 2.1). Frequencies are in 1/t_c."""

    base_frequency: Annotated[Positive[float], FREQUENCY] = 0.2
    """Frequency of the carrier, which is close to the wake's shedding frequency."""
    modulation_cutoff: Annotated[Positive[float], FREQUENCY] = 0.05
    """Cut-off frequency of the low-pass filter for the noise that modulates the carrier's frequency."""
    modulation_index: Annotated[NonNegative[float], FREQUENCY] = 0.25
    """Largest deviation of the carrier's frequency from `forcing.base_frequency`."""
    envelope_frequency: Annotated[Positive[float], FREQUENCY] = 0.005
    """Frequency of the slow sine that modulates the amplitude."""
    envelope_depth: Fraction[float] = 0.45
    """Largest share by which the slow sine reduces or raises the amplitude."""
    chirp_start: Annotated[Positive[float], FREQUENCY] = 0.1
    """Start frequency of the test episode's chirp, which ends at `forcing.chirp_end`."""
    chirp_end: Annotated[Positive[float], FREQUENCY] = 0.4
    extended_chirp_start: Annotated[Positive[float], FREQUENCY, paper("appendix A")] = 0.01
    """Start frequency of the extended chirp, which goes beyond the frequencies of the training waveform (paper,
    appendix A)."""
    extended_chirp_end: Annotated[Positive[float], FREQUENCY, paper("appendix A")] = 0.8
    exploration_time: Annotated[
        Positive[float], TIME, ours("a fifth of a shedding cycle", page="how-to/record-data.md")
    ] = 1.0
    """Correlation time of the noise that is added to a controller's commands in a recording. The default is long enough
    for the wake to respond."""


@dataclass(frozen=True, kw_only=True)
class OpenFoamConfig(Settings, source=ours("the second plant is not the paper's case", page="how-to/use-openfoam.md")):
    """The mesh and initial flow of OpenFOAM, the second plant. A coupled run has the time step of `flow`."""

    refinement: Annotated[float, _REFINEMENT, ours("the mesh of the comparison", page="how-to/use-openfoam.md")] = 1.0
    """Divisor of all spacings of the body-fitted mesh; a finer mesh needs a smaller time step."""
    develop_time: Annotated[Positive[float], TIME] = 50.0
    """Time that OpenFOAM simulates without jets before the first run, from the developed wake of stillwake's solver."""
    develop_substeps: AtLeastOne[int] = 20
    """Number of time steps per control period during `openfoam.develop_time`."""
