"""The command around a search: what it writes and says, how it goes on, what it refuses."""

import json
from pathlib import Path
from typing import ClassVar

import pytest

from contract.config.tree import Config
from contract.errors import ExportError
from contract.shipped import BUNDLE, MODEL
from firmware_sim.tuning.score import PhaseFigures

QUICK = ("--trials", 3, "--phases", 2, "--judged-phases", 2, "--seed", 4)


class MadeUpRuns:
    """Stands for the loop on the wake: the reduction falls with the distance of the lift weight from 0.2."""

    made: ClassVar[list[tuple[float, int, float]]] = []
    stop_after = 10**6
    trouble: str | None = None

    def __init__(self, bundle, config: Config, *, wake_at, spans, goal, controller) -> None:
        self._refinement = config.flow.refinement

    def __call__(self, mpc, phase, report, periods=lambda done, total: None) -> PhaseFigures:
        if len(self.made) == self.stop_after:
            raise KeyboardInterrupt
        periods(1, 2)
        type(self).made = [*self.made, (mpc.weights.lift, phase, self._refinement)]
        found = 26.0 - 100.0 * abs(mpc.weights.lift - 0.2) + 0.1 * phase + 1e3 * mpc.learning_rate
        return PhaseFigures(
            reduction_percent=found,
            abs_Cl=0.1,
            mean_Cl=0.0,
            rms_action=0.03,
            jet_power=0.04,
            Cd_net_reduction_percent=found + 5.0,
            trouble=self.trouble,
        )


@pytest.fixture
def runs(monkeypatch) -> type[MadeUpRuns]:
    monkeypatch.setattr(MadeUpRuns, "made", [])
    monkeypatch.setattr(MadeUpRuns, "stop_after", 10**6)
    monkeypatch.setattr("firmware_sim.tuning.loop.WakeRuns", MadeUpRuns)
    monkeypatch.setattr("firmware_sim.tuning.starts.starts_at", lambda folder, config, periods, progress: [])
    monkeypatch.setattr("firmware_sim.tuning.starts.phases_of", lambda config, starts: None)
    return MadeUpRuns


@pytest.mark.slow  # draws the search
def test_a_search_ends_with_table_verdict_command_and_files(cli, runs, tmp_path) -> None:
    folder, file = tmp_path / "out", tmp_path / "tune.json"
    outcome = cli("tune", folder, *QUICK, "--vary", "lift", "--json", file)
    assert (outcome.code, outcome.err) == (0, "")
    assert {path.name for path in folder.iterdir()} >= {"trials.log", "tuning.json", "tuning.png"}
    result = json.loads(file.read_text())
    assert result == json.loads((folder / "tuning.json").read_text())
    figures = result["figures"]
    lifts = [trial["settings"]["mpc.weights.lift"] for trial in figures["trials"]]
    scores = [trial["score"] for trial in figures["trials"]]
    assert lifts[0] == 0.1
    assert scores == pytest.approx([27.75 - 100.0 * abs(lift - 0.2) for lift in lifts])
    best = lifts[scores.index(max(scores))]
    assert best != 0.1
    assert figures["best"]["weights"]["lift"] == best
    assert [one["name"] for one in figures["judged"]] == ["present", "best"]
    assert figures["clearly_better"] and "clearly better" in outcome.out
    # The search is on the coarse mesh, the judgement on the default one.
    assert [refinement for _, _, refinement in runs.made] == [0.75] * 6 + [1.0] * 4
    assert f"stillwake bundle renew {BUNDLE} NEW" in outcome.out
    assert f"--set mpc.weights.lift={best:g}\n" in outcome.out


def verdict(folder: Path) -> str:
    return str(json.loads((folder / "tuning.json").read_text())["figures"]["verdict"])


@pytest.mark.slow  # searches twice
def test_a_search_that_was_stopped_has_a_verdict_and_goes_on(cli, refused, runs, monkeypatch, tmp_path) -> None:
    call = ("tune", tmp_path / "out", *QUICK, "--vary", "lift")
    for runs.stop_after in (0, 3):
        outcome = cli(*call)
        assert outcome.code == 130
        assert outcome.err.endswith("out keeps the finished trials, the same command continues it\n")
        assert verdict(tmp_path / "out").startswith("stopped before there was a judgement")
    runs.stop_after = 10**6
    more = cli(*call, "--trials", 4)
    assert verdict(tmp_path / "out").startswith("clearly better")
    assert more.code == 0 and "4 trials" in more.out
    # The second trial was cut in its second run: three runs before, two of them made again, two trials, four judged.
    assert len(runs.made) == 3 + 6 + 4
    # Another search in the folder is refused, and replaces it only when asked to.
    assert "holds a search with other goal; give --overwrite" in refused(*call, "--lift-bound", 0.3)
    # So has one whose present settings do not hold control.
    monkeypatch.setattr(runs, "trouble", "ECU FAULT")
    outcome = cli("tune", tmp_path / "other", *QUICK)
    assert (outcome.code, outcome.err) == (1, f"error: {verdict(tmp_path / 'other')}\n")
    assert verdict(tmp_path / "other").endswith("cannot be compared with: ECU FAULT")


@pytest.mark.slow  # draws the search
def test_settings_whose_export_is_refused_are_skipped(cli, runs, monkeypatch, tmp_path) -> None:
    def refuse(*args: object, **options: object) -> None:
        raise ExportError("int8 weights: max_cost_gap is 0.0029, at most 0.001 is allowed")

    monkeypatch.setattr("export.release.pipeline.export_all", refuse)
    outcome = cli("tune", tmp_path, *QUICK, "--vary", "learning_rate", "--try", "learning_rate=0.004")
    assert (outcome.code, outcome.err) == (0, "")
    assert "1             │ int8 weights: max_cost_gap is 0.0029" in outcome.out
    assert verdict(tmp_path) == "not better: no settings that scored better than the present ones can be exported"
    trials = json.loads((tmp_path / "tuning.json").read_text())["figures"]["trials"]
    assert [trial["skipped"] is None for trial in trials[:2]] == [True, False]


def test_what_cannot_be_searched_is_refused_before_anything_is_written(all_refused, runs) -> None:
    all_refused(
        "tune out",
        {
            "--hours 0": "--hours 0.0: must be above 0, at most 10000",
            "--hours nan": "--hours nan: must be above 0",
            "--vary drag_mean": "--vary drag_mean: cannot be tuned; one of drag_fluctuation,",
            "--lift-bound -1": "--lift-bound -1.0: must be a number, at least 0",
            "--refinement 0": "flow.refinement",
            "--set train.epochs=3": "--set train.epochs: `tune` does not use it",
            "--set flow.control_period=0.1": "0.2, the flow has 0.1: set flow.control_period=0.2",
            "--dataset missing.h5": "missing.h5: No such file or directory",
        },
    )


def test_a_bundle_without_its_model_is_tuned_in_its_weights(cli, refused, runs, random_release, tmp_path) -> None:
    call = ("tune", tmp_path / "out", "--bundle", random_release, *QUICK)
    fixed = "--vary horizon: fixed in the bundle's graph; name the bundle's model with --model"
    assert fixed in refused(*call, "--vary", "horizon")
    assert "name the bundle's own with --model" in refused(*call, "--model", MODEL)
    done = cli(*call, "--judged-phases", 0)
    assert done.code == 0 and "only weights are tuned" in done.out
    settings = json.loads((tmp_path / "out" / "tuning.json").read_text())["figures"]["trials"][1]["settings"]
    assert "mpc.horizon" not in settings and len(settings) == 6
