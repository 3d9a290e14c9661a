"""Real runs of a few periods on dask workers."""

from pathlib import Path

import pytest

from contract.config.tree import Config
from contract.errors import StillwakeError
from contract.release import bundle
from firmware_sim.campaign.conduct import Campaign, conduct
from firmware_sim.campaign.execution import execute
from firmware_sim.campaign.folder import CampaignFolder
from firmware_sim.campaign.task import Timing
from tests.firmware_sim.campaign.conftest import scenario_of
from wake.recording import parallel

pytestmark = pytest.mark.processes  # starts dask workers, which run the real wake


@pytest.fixture(scope="module")
def campaign(short_release, shared_wake) -> Campaign:
    return Campaign(
        scenarios=(
            scenario_of("undisturbed"),
            scenario_of(
                "rough", disturb=("noise:level=0.5", "ecu:drop:probability=0.3", "gust:amplitude=0.1,period=2")
            ),
        ),
        bundle=bundle.load(short_release),
        config=Config(),
        timing=Timing(lead_in=1.2, controlled=0.8, settle=0.2),
        phases=1,
        seed=3,
    )


def files(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in sorted(folder.rglob("*.json"))}


def test_one_worker_and_two_write_the_same_bytes(campaign, tmp_path) -> None:
    campaign.check()
    alone, together = tmp_path / "alone", tmp_path / "together"
    one, other = (
        conduct(campaign, CampaignFolder(folder), workers=workers) for folder, workers in ((alone, 1), (together, 2))
    )
    assert one.rows == other.rows
    assert files(alone) == files(together)
    assert {"campaign.json", "runs/rough.phase0.json", "runs/rough.uncontrolled.phase0.json"} <= files(alone).keys()
    assert one.safe


def test_a_scheduler_that_is_not_there_is_said(campaign, monkeypatch) -> None:
    from tests.firmware_sim.campaign.test_task import TASK
    from wake.truck.state import developed_state

    # dask asks again and again until then.
    monkeypatch.setattr(parallel, "_CONNECT_S", 1.0)
    with pytest.raises(StillwakeError, match="cannot reach scheduler"):
        execute(
            [TASK],
            campaign.bundle,
            [developed_state()],
            workers=1,
            scheduler="tcp://127.0.0.1:1",
            finished=lambda task, outcome: None,
        )
