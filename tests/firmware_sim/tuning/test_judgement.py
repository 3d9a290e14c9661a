"""The winner next to the present: what counts as clearly better, and that finished runs are not made again."""

from dataclasses import replace

from contract.config.controller import CostWeights, MpcConfig
from firmware_sim.tuning.judgement import Candidate, Judged, is_clearly_better, judge, verdict
from firmware_sim.tuning.score import Goal, PhaseFigures

CANDIDATE = Candidate(name="best", mpc=MpcConfig(), digest="0" * 64, vehicle={"flow": {"refinement": 1.0}})


def run_of(reduction, abs_Cl=0.1) -> PhaseFigures:
    return PhaseFigures(reduction_percent=reduction, abs_Cl=abs_Cl, mean_Cl=0.0, rms_action=0.03, jet_power=0.04)


def judged(*reductions, abs_Cl=0.1) -> Judged:
    return Judged(candidate=CANDIDATE, runs=tuple(run_of(one, abs_Cl) for one in reductions))


def test_a_winner_must_gain_more_than_the_spread_within_the_bound() -> None:
    for winner, better, words in [
        (judged(27.0, 27.4), True, "clearly better: +2.00 points, more than the spread over the phases"),
        (judged(25.0, 25.8), False, "not clearly better: +0.20 points, within the spread over the phases"),
        (judged(22.0, 34.0), False, "not clearly better: +2.80 points, within the spread over the phases"),
        (judged(27.0, 27.4, abs_Cl=0.25), False, "not better: mean |Cl| of 0.250 is above 0.2"),
        (judged(27.0, None), False, "not better: control was not held in every run"),
    ]:
        present = judged(25.0, 25.4)
        assert is_clearly_better(winner, present, Goal()) == better, winner
        assert verdict(winner, present, Goal()) == words, winner
    assert verdict(None, judged(25.0), Goal()) == "no settings scored better than the present ones"


def test_kept_runs_are_not_made_again(tmp_path) -> None:
    made = []

    def run(mpc: MpcConfig, phase: int) -> PhaseFigures:
        made.append(phase)
        return run_of(20.0 + phase)

    first = judge(tmp_path, CANDIDATE, (0, 8, 17), run)
    (tmp_path / f"{CANDIDATE.key}_8.json").write_text("{")
    assert judge(tmp_path, CANDIDATE, (0, 8, 17), run) == first
    assert made == [0, 1, 2, 1]
    # Another number of phases has other starts.
    judge(tmp_path, CANDIDATE, (0, 12), run)
    assert made == [0, 1, 2, 1, 1]
    assert first.spread("reduction_percent") == (21.0, 20.0, 22.0)
    # They are kept by settings and program.
    others = (
        replace(CANDIDATE, mpc=MpcConfig(weights=CostWeights(lift=0.3))),
        replace(CANDIDATE, mpc=MpcConfig(learning_rate=2e-3)),
        replace(CANDIDATE, digest="1" * 64),
        replace(CANDIDATE, vehicle={"flow": {"refinement": 0.9}}),
    )
    assert len({one.key for one in (CANDIDATE, *others)}) == 5
    assert replace(CANDIDATE, name="present").key == CANDIDATE.key
