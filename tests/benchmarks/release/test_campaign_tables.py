"""The campaign's tables, from a file whose figures are known."""

import json

import pytest

from benchmarks.release.campaign_tables import MISSING, tables
from tests.firmware_sim.campaign.conftest import phase_of, rows_of, scenario_of


@pytest.fixture
def results(tmp_path):
    rows = rows_of(
        (scenario_of("delay_12"), [phase_of(0.82), phase_of(0.80)]),
        (scenario_of("delay_12_uncompensated"), [phase_of(1.1, broken=["it broke"])]),
        (scenario_of("lost"), [phase_of(failure="it diverged")]),
    )
    facts = {"bundle_name": "small", "phases": 2, "controlled": 60.0, "settle": 20.0}
    content = {"date": "2026-01-02", "figures": [row.figures() for row in rows], "facts": facts}
    (tmp_path / "campaign.json").write_text(json.dumps(content))
    return tmp_path


def test_every_scenario_has_a_row(results) -> None:
    matrix = tables(results)["campaign"].splitlines()
    assert "| undisturbed | What undisturbed says. | safe | useful | 20.0 | 0.20 | 100 |  |" in matrix
    assert "| delay_12 | What delay_12 says. | safe | useful | 19.0 (18.0 to 20.0) | 0.20 | 100 |  |" in matrix
    assert "| lost | What lost says. | **UNSAFE** | none | - | - | - |  |" in matrix
    assert "averages over the last\n40. 2 of 4 scenarios are safe." in tables(results)["campaign"]


def test_delay_stands_beside_the_paper(results) -> None:
    table = tables(results)["campaign_paper"].splitlines()
    # 1.051 to 0.918 and to 0.950 (appendix B).
    assert table[2:] == [
        "| 0 | 20.0 | 0.20 | 20.0 | 0.20 | 12.7 |",
        "| 12 | 19.0 | 0.20 | -10.0 | 0.20 | 9.6 |",
    ]


def test_without_a_campaign_the_page_says_so(tmp_path) -> None:
    assert set(tables(tmp_path).values()) == {MISSING}
