"""The campaign's page in a browser."""

from collections.abc import Iterator
from datetime import date
from pathlib import Path

import pytest

from contract.config.tree import Config
from firmware_sim.campaign.conduct import Campaign, Result
from firmware_sim.campaign.folder import CampaignFolder
from firmware_sim.campaign.report import write_report
from firmware_sim.campaign.task import Timing
from tests.browser import PHONE, chromium, visit
from tests.firmware_sim.campaign.conftest import phase_of, rows_of, scenario_of
from tests.firmware_sim.conftest import make_bundle

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def report(tmp_path_factory) -> Path:
    """With every verdict that a scenario can have."""
    rows = rows_of(
        (scenario_of("noise_0.5", "Noise"), [phase_of(0.85), phase_of(0.87)]),
        (scenario_of("delay_4", "Delay", settings=("ecu.delay_steps=4",)), [phase_of(0.95), phase_of(0.93)]),
        (scenario_of("lost", "Bus", disturb=("ecu:drop",)), [phase_of(1.0, in_control=9, latches=1), phase_of()]),
        (scenario_of("bad", "Bus"), [phase_of(broken=["period 3: jets_shut"]), phase_of(failure="it diverged")]),
    )
    campaign = Campaign(
        scenarios=tuple(row.scenario for row in rows),
        bundle=make_bundle(),
        config=Config(),
        timing=Timing(lead_in=1.2, controlled=60.0, settle=20.0),
        phases=2,
    )
    folder = CampaignFolder(tmp_path_factory.mktemp("campaign") / "c")
    write_report(folder, campaign, Result(rows=rows, made=1, kept=0), date(2026, 1, 2))
    return folder.report


@pytest.fixture(scope="module")
def browser() -> Iterator:
    with chromium() as found:
        yield found


def test_it_opens_without_a_fault_for_all_readers(browser, report):
    url = report.as_uri()
    for width, dark in ((1280, True), (PHONE, False)):
        seen = visit(browser, url, home=url, width=width, dark=dark)
        assert not seen.violations(), (width, dark)
        assert not seen.is_wider_than_its_window, (width, dark)
        assert not seen.troubles, (width, dark)
        seen.page.context.close()
