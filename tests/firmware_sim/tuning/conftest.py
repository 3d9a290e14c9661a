"""A loop whose best settings are known: a paraboloid in place of a wake, and a clock that its runs move."""

from dataclasses import dataclass, field

import pytest

from contract.config.controller import MpcConfig
from firmware_sim.tuning.score import Goal, PhaseFigures
from firmware_sim.tuning.search import Plan

BLOCKS = 5


class Stopped(Exception):  # noqa: N818  (what stops a process is no error of the program)
    """As if the process was killed."""


@dataclass
class MadeUpLoop:
    """Runs of 10 s each, whose reduction is largest, 30, with a lift weight of 0.2 and a smoothness of 8.

    Attributes:
        made: (settings, phase) of every run, as far as it went.
        stop_in: number of the run in which the process is killed.
    """

    now: float = 0.0
    stop_in: int | None = None
    trouble: bool = False
    made: list[tuple[MpcConfig, int]] = field(default_factory=list)
    blocks: int = 0

    def clock(self) -> float:
        return self.now

    def __call__(self, mpc: MpcConfig, phase: int, report) -> PhaseFigures:
        self.made.append((mpc, phase))
        if len(self.made) - 1 == self.stop_in:
            raise Stopped
        weights = mpc.weights
        found = 30.0 - 400.0 * (weights.lift - 0.2) ** 2 - 0.3 * (weights.smoothness - 8.0) ** 2 + 0.01 * phase
        for block in range(BLOCKS):
            self.now += 2.0
            self.blocks += 1
            report(block, found)
        return PhaseFigures(
            reduction_percent=found,
            abs_Cl=0.1,
            mean_Cl=0.0,
            rms_action=0.03,
            jet_power=0.04,
            trouble="ECU FAULT: made up" if self.trouble else None,
        )


@pytest.fixture
def loop() -> MadeUpLoop:
    return MadeUpLoop()


def plan_of(*, seconds=1e6, trials=None, seed=3, phases=2, tries=()) -> Plan:
    return Plan(
        present=MpcConfig(),
        names=("mpc.weights.lift", "mpc.weights.smoothness"),
        phases=phases,
        blocks=BLOCKS,
        goal=Goal(),
        seed=seed,
        seconds=seconds,
        trials=trials,
        tries=tries,
    )
