"""One run of the loop for the search: through CAN as `stillwake run`, scored block by block while it goes on."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Final

from contract.config.controller import MpcConfig
from contract.config.tree import Config
from contract.controller.interface import RunnableController
from contract.errors import PlantError
from contract.release.checks import Bundle
from firmware_sim.bench.simulation import simulate
from firmware_sim.bench.spans import Spans
from firmware_sim.runs.run_log import Row
from firmware_sim.runs.summary import summary
from firmware_sim.tuning.score import Goal, PhaseFigures
from wake.plant.protocol import LoopPlant

BLOCK: Final = 10.0
"""t_c of a block: two shedding cycles."""

Report = Callable[[int, float], None]
"""Called with a block's number and its score, once the block is over; may raise to end the run."""


def blocks_in(controlled: float) -> int:
    """Whole blocks in the time with control."""
    return int(controlled / BLOCK + 1e-9)


def of_settings(bundle: Bundle, mpc: MpcConfig) -> Bundle:
    """The release as if it had these settings; its hash stays, so it is for runs only, never to be written."""
    return replace(bundle, manifest=replace(bundle.manifest, mpc=mpc))


class WakeRuns:
    """The loop from several phases, with any settings.

    Args:
        bundle: verified release, whose settings are replaced.
        config: the vehicle, its flow that of the phases.
        wake_at: the flow at the start of a phase.
        spans: of every run.
        goal: for the scores of the blocks.
        controller: makes what computes the control step with these settings.
    """

    def __init__(
        self,
        bundle: Bundle,
        config: Config,
        *,
        wake_at: Callable[[int], LoopPlant],
        spans: Spans,
        goal: Goal,
        controller: Callable[[MpcConfig], RunnableController],
    ) -> None:
        self._bundle, self._config, self._wake_at, self._spans = bundle, config, wake_at, spans
        self._goal, self._controller = goal, controller

    def __call__(
        self, mpc: MpcConfig, phase: int, report: Report, periods: Callable[[int, int], None] = lambda done, total: None
    ) -> PhaseFigures:
        """The figures of a run.

        Args:
            mpc: settings.
            phase: number of its start.
            report: see `Report`.
            periods: called with control periods done and in all.

        Raises:
            StillwakeError: if the settings do not fit the vehicle. A flow that diverges is a figure.
        """
        config = self._config
        lead_in, _ = self._spans.periods(config.flow.control_period)
        course = Course(lead_in=lead_in, block=round(BLOCK / config.flow.control_period), goal=self._goal)

        def see(row: Row, done: int, total: int) -> None:
            periods(done, total)
            found = course.with_row(row.sample.Cd, row.sample.Cl)
            if found is not None:
                report(*found)

        try:
            log = simulate(
                of_settings(self._bundle, mpc),
                replace(config, mpc=mpc),
                spans=self._spans,
                wake=self._wake_at(phase),
                controller=self._controller(mpc),
                progress=see,
            )
        except PlantError as error:
            return PhaseFigures.failed(str(error))
        return PhaseFigures.of(summary(log))


@dataclass(kw_only=True)
class Course:
    """Drag and lift of a run as it goes on, and the score of each block against the time without control.

    Attributes:
        lead_in: control periods without control.
        block: control periods of a block.
    """

    lead_in: int
    block: int
    goal: Goal
    _free: list[float] = field(default_factory=list)
    _drag: list[float] = field(default_factory=list)
    _lift: list[float] = field(default_factory=list)
    _blocks: int = 0

    def with_row(self, Cd: float, Cl: float) -> tuple[int, float] | None:
        """Take in a control period; number and score of the block that ends with it."""
        if len(self._free) < self.lead_in:
            self._free.append(Cd)
            return None
        self._drag.append(Cd)
        self._lift.append(abs(Cl))
        if len(self._drag) < self.block:
            return None
        before, under = (sum(part) / len(part) for part in (self._free, self._drag))
        score = self.goal.points(100.0 * (1.0 - under / before), sum(self._lift) / len(self._lift))
        number, self._blocks = self._blocks, self._blocks + 1
        self._drag.clear()
        self._lift.clear()
        return number, score
