"""Outcomes made by hand, so that what is made of them can be worked out on paper."""

from collections.abc import Sequence
from dataclasses import replace

import pytest

from firmware_sim.campaign import conduct as conducting
from firmware_sim.campaign.folder import CampaignFolder, KeptCourse, MeanFigures, RunOutcome, RunService
from firmware_sim.campaign.judgement import PhaseOutcomes, ScenarioRow, judged
from firmware_sim.campaign.scenario import UNDISTURBED, Place, Scenario
from wake.truck.state import State, developed_state

FREE = MeanFigures(Cd=1.0, abs_Cl=0.9, mean_Cl=0.0, rms_action=0.0)


def scenario_of(name: str, group: str = "a group", **fields) -> Scenario:
    return Scenario(name=name, group=group, sentence=f"What {name} is.", **fields)


def phase_of(Cd=0.8, *, abs_Cl=0.2, in_control=100, latches=0, broken=(), failure="") -> PhaseOutcomes:
    """A run of 100 periods against a free flow with Cd = 1 and |Cl| = 0.9."""
    lift, action = [0.9, abs_Cl, -abs_Cl], [0.0, 0.01, 0.02]
    course = KeptCourse(t=[0.0, 0.2, 0.4], Cd=[1.0, Cd, Cd], Cl=lift, action=action, enabled_t=0.2)
    frames = {"frames_sent": 200, "frames_lost": 3, "frames_rejected": 1}
    held = {"requested": 100, "in_control": in_control, "latches": latches, "violations": len(broken)}
    reasons = {} if in_control == 100 else {"STREAM_LOST": 100 - in_control}
    service = RunService(**held, **frames, reasons=reasons, broken=list(broken))
    figures = MeanFigures(Cd=Cd, abs_Cl=abs_Cl, mean_Cl=0.01, rms_action=0.03)
    under = RunOutcome(key="k", figures=figures, course=course, service=service)
    if failure:
        under = RunOutcome(key="k", failure=failure)
    return PhaseOutcomes(under=under, free=RunOutcome(key="f", figures=FREE, course=replace(course, action=[0.0] * 3)))


def rows_of(*others: tuple[Scenario, Sequence[PhaseOutcomes]], undisturbed=None) -> tuple[ScenarioRow, ...]:
    """The undisturbed scenario, 20 % less drag without other phases, and others."""
    everything = [(scenario_of(UNDISTURBED, "Undisturbed"), undisturbed or [phase_of(), phase_of()]), *others]
    return judged([one for one, _ in everything], {one.name: phases for one, phases in everything})


@pytest.fixture
def place() -> Place:
    """A release whose third sensor is on the base; control is asked for at 0.7 s, and a t_c takes 0.1 s."""
    return Place(sensors=("upper_39", "lower_39", "base_0", "base_9"), base_sensor="base_0", enabled_s=0.7, t_c_s=0.1)


class Worker:
    """Stands for the workers, whose runs take minutes: made-up outcomes by the scenario's name, with its drag under
    control, or as `phase_of` has it. `kept` are the folders from which starting states were to be taken. It stops after
    so many runs; the task `failing` falls over, and in the scenario `unsafe` an invariant breaks."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, **drag: float) -> None:
        self.ran, self.kept = list[str](), list[CampaignFolder | None]()
        self.started: dict[str, State] = {}
        self.drag, self.stop_after, self.failing, self.unsafe = drag, 10**6, "", ""
        start = developed_state()
        start = replace(start, flat=start.flat[:100])  # a small file
        monkeypatch.setattr(conducting, "spread", self)
        # Of another body's wake, as far as a hash can tell.
        other = replace(start, flat=2.0 * start.flat)

        def states(folder, config, phases, name, _) -> tuple[State, ...]:
            self.kept.append(folder)
            return (other if name else start,) * phases

        monkeypatch.setattr(conducting, "starting_states", states)

    def __call__(self, tasks, call, *, finished, **_) -> None:
        for task in tasks:
            *_, self.started[task.name] = call(task)
            if len(self.ran) == self.stop_after:
                raise KeyboardInterrupt
            self.ran.append(task.name)
            scenario = task.name.rpartition(".phase")[0]
            broken = ["period 3: jets_shut"] if scenario == self.unsafe else []
            phase = phase_of(self.drag.get(scenario, 0.8), broken=broken)
            outcome = phase.under if task.controlled else phase.free
            finished(task, RunOutcome(key="", failure="it fell over") if task.name == self.failing else outcome)
