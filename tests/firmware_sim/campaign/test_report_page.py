"""The campaign's page in a browser."""

import pytest

from tests.browser import PHONE, chromium, visit
from tests.firmware_sim.campaign.conftest import phase_of, rows_of, scenario_of
from tests.firmware_sim.campaign.test_report import written

pytestmark = [pytest.mark.browser, pytest.mark.usefixtures("no_pictures")]


@pytest.mark.proofs  # a browser; the page of a run has one
def test_it_opens_without_a_fault_for_all_readers(tmp_path):
    """With every verdict that a scenario can have."""
    rows = rows_of(
        (scenario_of("noise_0.5", "Noise"), [phase_of(0.85), phase_of(0.87)]),
        (scenario_of("delay_4", "Delay", settings=("ecu.delay_steps=4",)), [phase_of(0.95), phase_of(0.93)]),
        (scenario_of("lost", "Bus", disturb=("ecu:drop",)), [phase_of(1.0, in_control=9, latches=1), phase_of()]),
        (scenario_of("bad", "Bus"), [phase_of(broken=["period 3: jets_shut"]), phase_of(failure="it diverged")]),
    )
    url = written(rows, tmp_path / "c")[0].report.as_uri()
    with chromium() as browser:
        for width, dark in ((1280, True), (PHONE, False)):
            seen = visit(browser, url, home=url, width=width, dark=dark)
            assert not seen.violations(), (width, dark)
            assert not seen.is_wider_than_its_window, (width, dark)
            assert not seen.troubles, (width, dark)
