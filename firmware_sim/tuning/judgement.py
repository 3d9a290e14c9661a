"""The winner against the present settings, on starts and a mesh that nothing was tuned on; finished runs are kept."""

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from contract.atomic import replacing
from contract.config.controller import MpcConfig
from firmware_sim.tuning.score import Goal, PhaseFigures


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """Settings to be judged, and the controller that has them.

    Attributes:
        name: for people.
        digest: of the release or the program that computes with them.
        vehicle: settings of vehicle and flow, as plain JSON.
    """

    name: str
    mpc: MpcConfig
    digest: str
    vehicle: Mapping[str, Any]

    @property
    def key(self) -> str:
        """By which its runs are kept."""
        text = json.dumps([asdict(self.mpc), self.digest, self.vehicle], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:12]


@dataclass(frozen=True, kw_only=True)
class Judged:
    """What came of a candidate, a run a phase."""

    candidate: Candidate
    runs: tuple[PhaseFigures, ...]

    @property
    def held(self) -> bool:
        """Whether control was held, and there are figures, in every run."""
        return all(run.trouble is None and run.reduction_percent is not None for run in self.runs)

    def spread(self, name: str) -> tuple[float, float, float]:
        """Mean, least and most of a figure that every run has; NaN where one has not."""
        values = [getattr(run, name) for run in self.runs]
        if None in values:
            return (float("nan"),) * 3
        return sum(values) / len(values), min(values), max(values)


def judge(
    folder: Path,
    candidate: Candidate,
    starts: Sequence[int],
    run: Callable[[MpcConfig, int], PhaseFigures],
    done: Callable[[bool], None] = lambda is_new: None,
) -> Judged:
    """The candidate's runs, those that are kept in the folder left out.

    Args:
        starts: control periods from the developed wake to each phase.
        run: makes the run from a phase, by its number.
        done: called after every run, with whether it was made and not kept from before.
    """
    runs = []
    for phase, start in enumerate(starts):
        file = folder / f"{candidate.key}_{start}.json"
        kept = _kept(file)
        figures = kept
        if figures is None:
            figures = run(candidate.mpc, phase)
            with replacing(file) as temporary:
                temporary.write_text(json.dumps(figures.to_tree()), encoding="utf-8")
        runs.append(figures)
        done(kept is None)
    return Judged(candidate=candidate, runs=tuple(runs))


def is_clearly_better(winner: Judged, present: Judged, goal: Goal) -> bool:
    """Whether the mean reduction rises by more than either one's spread, with |Cl| within the bound in every run."""
    if not (winner.held and present.held):
        return False
    (mean, low, high), (old_mean, old_low, old_high) = (one.spread("reduction_percent") for one in (winner, present))
    return mean - old_mean > max(high - low, old_high - old_low) and winner.spread("abs_Cl")[2] <= goal.lift_bound


def verdict(winner: Judged | None, present: Judged, goal: Goal) -> str:
    """One sentence for people."""
    if winner is None:
        return "no settings scored better than the present ones"
    gain = winner.spread("reduction_percent")[0] - present.spread("reduction_percent")[0]
    if is_clearly_better(winner, present, goal):
        return f"clearly better: {gain:+.2f} points, more than the spread over the phases"
    if not winner.held:
        return "not better: control was not held in every run"
    if winner.spread("abs_Cl")[2] > goal.lift_bound:
        return f"not better: mean |Cl| of {winner.spread('abs_Cl')[2]:.3f} is above {goal.lift_bound:g}"
    return f"not clearly better: {gain:+.2f} points, within the spread over the phases"


def to_tree(judged: Sequence[Judged]) -> list[dict[str, Any]]:
    """As plain JSON."""
    return [
        {
            "name": one.candidate.name,
            "mpc": asdict(one.candidate.mpc),
            "digest": one.candidate.digest,
            "runs": [run.to_tree() for run in one.runs],
        }
        for one in judged
    ]


def _kept(file: Path) -> PhaseFigures | None:
    """The figures in a file; None if it is not there, or not one of these."""
    try:
        return PhaseFigures(**json.loads(file.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        return None
