"""A saved run is one that `stillwake run` could have left."""

import json

import numpy as np
import pytest

from firmware_sim.live import saving
from firmware_sim.runs import run_log, wake_stills
from firmware_sim.runs.run_folder import RunFolder
from tests.firmware_sim.live.harness import Live, shown


@pytest.fixture
def undrawn(monkeypatch) -> None:
    """Pictures and reports take seconds."""
    for name in ("draw", "write_report"):
        monkeypatch.setattr(saving, name, lambda *_: None)


@pytest.mark.slow  # draws a report
def test_the_latest_periods_are_saved_when_the_first_are_gone(tmp_path):
    live = Live(tmp_path, kept=100).run(30).set(noise=0.5).run(70).set(noise=0.0, loss=0.2).run(50)
    (tmp_path / "live-20260102-120000").mkdir()
    answer = live.ask(save=True)
    assert answer == {"saved": "live-20260102-120000-2"}
    folder = RunFolder(tmp_path / answer["saved"])
    log = run_log.load(folder.series)
    np.testing.assert_allclose(log.series["t"], 0.2 * np.arange(50, 150))
    assert (len(log.series["t"]), log.enabled_at) == (100, 0)
    noise, loss = log.metadata.faults
    # It acted in every period; of the 70, fifty are kept.
    assert (noise.text, noise.acted) == ("noise:level=0.5@0.6..2.0", 50)
    assert loss.text == "ecu:drop:probability=0.2,at=receive@2.0.."
    # Three frames a period, of which none was lost on the bus itself.
    assert log.traffic.frames == pytest.approx(300, abs=2)
    assert json.loads(folder.summary.read_text())["started_with"]["flow"] == "period 50 of a live session"
    assert "noise:level=0.5@0.6..2.0" in folder.report.read_text()


def test_it_is_saved_what_computed_and_from_when_on(tmp_path, undrawn):
    live = Live(tmp_path).run(150).set(controller="c").run(20).set(weights={"lift": 0.5}).run(5)
    metadata = run_log.load(RunFolder(tmp_path / live.ask(save=True)["saved"]).series).metadata
    assert metadata.computed_by.endswith("from 3 s waves by c; from 3.4 s calibration of the cost: lift 0.5")
    assert metadata.weights.lift == 0.5


def test_a_run_that_cannot_be_written_leaves_nothing(tmp_path):
    live = Live(tmp_path / "saves")
    assert "no period" in live.ask(save=True)["error"]
    live.run(5)
    (tmp_path / "saves").write_text("a file in the way")
    assert "cannot write" in live.ask(save=True)["error"]
    assert sorted(tmp_path.iterdir()) == [tmp_path / "saves"]


def test_the_flow_is_shown_and_saved(tmp_path, undrawn):
    live = Live(tmp_path, wake=shown, enable_after=0.4).run(4)
    width, height = live.heard["hello"]["raster"]
    assert len(live.pictures) == 4
    levels = np.frombuffer(live.pictures[-1][-width * height :], np.int8).reshape(height, width)
    # Counter-clockwise above the middle.
    assert levels[: height // 3].mean() > 20 and levels[-height // 3 :].mean() < -20
    folder = RunFolder(tmp_path / live.ask(save=True)["saved"])
    stills = wake_stills.load(folder.wake, run_log.load(folder.series))
    assert np.abs(stills.levels(3).astype(int) - levels).mean() < 3.0
