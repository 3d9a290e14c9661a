"""Real runs of a few periods on dask workers."""

from pathlib import Path

import pytest

from contract import side_by_side
from contract.config.tree import Config
from contract.errors import StillwakeError
from contract.release import bundle
from firmware_sim.bench.simulation import Spans
from firmware_sim.campaign import conduct as conducting
from firmware_sim.campaign.conduct import Campaign, conduct
from firmware_sim.campaign.folder import CampaignFolder
from tests.firmware_sim.campaign.conftest import scenario_of

pytestmark = pytest.mark.processes  # starts dask workers, which run the real wake


ROUGH = ("noise:level=0.5", "ecu:drop:probability=0.3", "gust:amplitude=0.1,period=1")


@pytest.fixture(scope="module")
def campaign(short_release, coarse) -> Campaign:
    return Campaign(
        scenarios=(scenario_of("undisturbed"), scenario_of("rough", disturb=ROUGH)),
        bundle=bundle.load(short_release),
        config=Config(flow=coarse.flow),
        timing=Spans(averages=False, lead_in=0.4, controlled=0.8, settle=0.2),
        phases=1,
        seed=3,
    )


@pytest.fixture(autouse=True)
def _started(coarse, monkeypatch) -> None:
    monkeypatch.setattr(
        conducting, "starting_states", lambda folder, config, phases, scenario, progress: (coarse.start,) * phases
    )


def files(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in sorted(folder.rglob("*.json"))}


def test_a_worker_writes_the_bytes_of_runs_in_this_process(campaign, tmp_path, monkeypatch) -> None:
    def here(tasks, call, *, finished, **_) -> None:
        for task in reversed(tasks):
            work, *given = call(task)
            finished(task, work(*given))

    campaign.check()
    together, alone = tmp_path / "together", tmp_path / "alone"
    by_workers = conduct(campaign, CampaignFolder(together), workers=1)
    monkeypatch.setattr(conducting, "spread", here)
    assert conduct(campaign, CampaignFolder(alone), workers=1).rows == by_workers.rows
    assert files(alone) == files(together)
    assert {"campaign.json", "runs/rough.phase0.json", "runs/rough.uncontrolled.phase0.json"} <= files(alone).keys()
    assert by_workers.safe


def test_a_scheduler_that_is_not_there_is_an_error(campaign, tmp_path, monkeypatch) -> None:
    # dask asks again and again until then.
    monkeypatch.setattr(side_by_side, "_CONNECT_S", 1.0)
    monkeypatch.delattr(conducting, "starting_states")  # takes minutes, so it comes after this check
    with pytest.raises(StillwakeError, match="cannot reach scheduler"):
        conduct(campaign, CampaignFolder(tmp_path / "out"), workers=1, scheduler="tcp://127.0.0.1:1")
    assert not (tmp_path / "out").exists()
