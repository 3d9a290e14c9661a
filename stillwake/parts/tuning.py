"""The work of `stillwake tune`, with progress: the search on a coarse mesh, then the judgement of its winner."""

import time
from collections.abc import Mapping
from dataclasses import replace
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from rich.progress import Progress, TaskID

from contract.config.controller import MpcConfig
from contract.config.loading import to_tree
from contract.config.plant import FlowConfig
from contract.config.tree import Config
from contract.release.checks import Bundle
from stillwake.console.terminal import progress_bar

if TYPE_CHECKING:
    import optuna

    from firmware_sim.bench.spans import Spans
    from firmware_sim.tuning.judgement import Judged
    from firmware_sim.tuning.score import Goal
    from firmware_sim.tuning.search import Plan
    from stillwake.parts.tuned_release import ModelOf

SEARCH: Final = {"lead_in": 10.0, "controlled": 60.0, "settle": 40.0}
"""The side force takes 40 t_c to calm down."""
JUDGEMENT: Final = {"lead_in": 25.0, "controlled": 100.0, "settle": 40.0}
"""As `stillwake run`."""
_STABLE: Final = 2 / 3
"""Of the default time steps, where the cells grow with the time step: `python -m benchmarks live-speed` has both."""
TUNED: Final = "bundle"
"""Folder of the winner's release, where it had to be exported."""


def _starts(place: Path, refinement: float) -> Path:
    return place / "starts" / f"mesh_{refinement:g}"


def coarse_flow(flow: FlowConfig, refinement: float) -> FlowConfig:
    """The flow on the mesh of the search: on a coarser one, with as few time steps as stay stable there."""
    coarse = replace(flow, refinement=refinement)
    if refinement >= flow.refinement:
        return coarse
    return replace(coarse, substeps=ceil(_STABLE * flow.substeps * refinement))


def spans_of(lengths: Mapping[str, float]) -> "Spans":
    from firmware_sim.bench.spans import Spans

    return Spans(lead_in=lengths["lead_in"], controlled=lengths["controlled"], settle=lengths["settle"])


def searched(
    study: "optuna.Study | None",
    plan: "Plan",
    label: Mapping[str, Any],
    release: Bundle,
    coarse: Config,
    source: "ModelOf | None",
    place: Path,
) -> "optuna.Study":
    """Make the trials that are missing, with progress in minutes of the budget; the study is begun if there is none."""
    from firmware_sim.tuning.loop import Report, WakeRuns
    from firmware_sim.tuning.score import PhaseFigures
    from firmware_sim.tuning.search import complete, finished, is_done, open_study, score_of, search, spent
    from firmware_sim.tuning.starts import phases_between, phases_of, starts_at
    from stillwake.parts.tuned_release import controller_of

    if study is not None and is_done(study, plan):
        return study
    with progress_bar("min", estimate_over=3600.0) as bar:
        task = bar.add_task("search", total=round(plan.seconds / 60.0, 1), note="")

        def settle(t: float, total: float) -> None:
            bar.update(task, completed=0, note=f"the wake settles on the coarse mesh: {t:.0f} of {total:.0f} t_c")

        bar.update(task, completed=0, note="preparing the starts")
        periods = phases_between(plan.phases, coarse.flow.control_period)
        runs = WakeRuns(
            release,
            coarse,
            wake_at=phases_of(coarse, starts_at(_starts(place, coarse.flow.refinement), coarse, periods, settle)),
            spans=spans_of(SEARCH),
            goal=plan.goal,
            controller=controller_of(release, source),
        )
        # Nothing is written before there is something to go on from.
        begun = open_study(place, label) if study is None else study
        before, since = spent(begun), time.monotonic()

        def run(mpc: MpcConfig, phase: int, report: Report) -> PhaseFigures:
            best = complete(begun)
            reached = f", best {score_of(best[0]):.2f}" if best else ""
            note = f"trial {len(finished(begun))}, run {phase + 1} of {plan.phases}{reached}"

            def show(done: int, total: int) -> None:
                minutes = (before + time.monotonic() - since) / 60.0
                bar.update(task, completed=min(round(minutes, 1), round(plan.seconds / 60.0, 1)), note=note)

            return runs(mpc, phase, report, show)

        search(begun, plan, run, clock=time.monotonic)
        bar.update(task, completed=round(plan.seconds / 60.0, 1), note="")
    return begun


def judged(
    release: Bundle, made: Bundle | None, config: Config, goal: "Goal", place: Path, phases: int
) -> "list[Judged]":
    """The present settings and the winner's, on the mesh of the settings, from starts that nothing was tuned on.

    Args:
        release: with the present settings.
        made: the winner's release; None if no settings are better.
        config, goal: of the runs.
        phases: starts; with 0 nothing is judged.
    """
    if phases == 0:
        return []
    from firmware_sim.campaign.starts import phases_apart
    from firmware_sim.tuning.judgement import Candidate, judge
    from firmware_sim.tuning.loop import WakeRuns
    from firmware_sim.tuning.score import PhaseFigures
    from firmware_sim.tuning.starts import phases_of, starts_at
    from stillwake.parts.tuned_release import controller_of

    spans = spans_of(JUDGEMENT)
    _, total = spans.periods(config.flow.control_period)
    found = list["Judged"]()
    with progress_bar("periods", estimate_over=3600.0) as bar:
        # Periods of the runs that are still to be made, and of those that were made by this call.
        whole, made_here = total * phases * (1 if made is None else 2), 0
        task = bar.add_task("judgement", total=whole, note="")
        bar.update(task, completed=0, note="preparing the starts")
        times = phases_apart(phases, config.flow.control_period)
        starts = starts_at(_starts(place, config.flow.refinement), config, times, lambda t, whole: _tick(bar, task))
        wake_at, vehicle = phases_of(config, starts), to_tree(replace(config, mpc=release.manifest.mpc))
        for name, one in (("present", release), ("best", made)):
            if one is None:
                continue
            runs = WakeRuns(
                one,
                config,
                wake_at=wake_at,
                spans=spans,
                goal=goal,
                controller=controller_of(one, None),
            )

            def run(mpc: MpcConfig, phase: int, runs: WakeRuns = runs, name: str = name) -> PhaseFigures:
                def show(done: int, _total: int) -> None:
                    bar.update(task, completed=made_here + done, note=f"{name}, run {phase + 1} of {phases}")

                return runs(mpc, phase, lambda block, score: None, show)

            def done(is_new: bool) -> None:
                nonlocal whole, made_here
                whole, made_here = (whole, made_here + total) if is_new else (whole - total, made_here)
                bar.update(task, completed=made_here, total=whole)

            manifest = one.manifest
            candidate = Candidate(name=name, mpc=manifest.mpc, digest=manifest.program_sha256, vehicle=vehicle)
            found.append(judge(place / "judged", candidate, times, run, done))
        bar.update(task, note="")
    return found


def _tick(bar: Progress, task: TaskID) -> None:
    bar.update(task, note="the wake settles on the mesh")
