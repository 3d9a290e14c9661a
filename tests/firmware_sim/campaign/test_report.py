"""What a campaign writes for readers: page, figures, table and the plan itself."""

import csv
import re
from datetime import date

import numpy as np
import pytest

from contract.config.tree import Config
from firmware_sim.bench.simulation import Spans
from firmware_sim.campaign.conduct import Campaign, Result
from firmware_sim.campaign.folder import CampaignFolder
from firmware_sim.campaign.report import curve, figures_of, write_report
from firmware_sim.campaign.scenario import Criteria
from tests.browser import PHONE, visit
from tests.ecu.conftest import make_bundle
from tests.firmware_sim.campaign.conftest import phase_of, rows_of, scenario_of

pytestmark = pytest.mark.slow  # draws pages


@pytest.fixture(scope="module")
def some_rows():
    return rows_of(
        (scenario_of("noise_0.5", "Noise"), [phase_of(0.85), phase_of(0.87)]),
        (scenario_of("delay_4", "Delay", settings=("ecu.delay_steps=4",)), [phase_of(0.82), phase_of(0.8)]),
        (scenario_of("delay_4_uncompensated", "Delay"), [phase_of(1.1), phase_of(1.0)]),
        (scenario_of("lost", "Bus", disturb=("ecu:drop",)), [phase_of(1.0, in_control=9, latches=1), phase_of()]),
        (scenario_of("strict", "Own", criteria=Criteria(useful=0.9)), [phase_of()] * 2),
    )


def written(rows, path) -> tuple[CampaignFolder, str]:
    scenarios, evil = tuple(row.scenario for row in rows), make_bundle(name="<b>evil</b>")
    timing = Spans(averages=False, lead_in=1.2, controlled=60.0, settle=20.0)
    campaign = Campaign(scenarios=scenarios, bundle=evil, config=Config(), timing=timing, phases=2)
    folder = CampaignFolder(path)
    write_report(folder, campaign, Result(rows=rows, made=1, kept=0), date(2026, 1, 2))
    return folder, folder.report.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def campaign(some_rows, tmp_path_factory) -> tuple[CampaignFolder, str]:
    return written(some_rows, tmp_path_factory.mktemp("campaign") / "c")


def test_the_page_needs_no_other_file_and_has_the_matrix_first(campaign, some_rows, tmp_path) -> None:
    folder, page = campaign
    sources = re.findall(r"""(?:src|srcset|href)\s*=\s*["']([^"'#][^"']*)""", page)
    references = sources + re.findall(r"url\(([^)]*)", page)
    assert len(references) == 3
    assert all(reference.startswith("data:image/png;base64,iVBOR") for reference in references)
    assert "<b>evil" not in page
    assert all(text in page for text in ("&lt;b&gt;evil", "<code>--lead-in 1.2</code>"))
    matrix = page[: page.index("</table>")]
    for row in some_rows:
        verdict = f'<td class="word safe">safe</td><td class="word {row.use}">{row.use}</td>'
        assert f"<td>{row.scenario.name}</td>{verdict}" in matrix
    assert page.index("</table>") < page.index("<img")
    assert page.count("Judged by criteria of its own: at least 0.9 of") == 1
    assert sorted(path.name for path in folder.figures.iterdir()) == ["delay.png", "noise.png", "overview.png"]
    with folder.table.open(encoding="utf-8", newline="") as file:
        table = {row["name"]: row for row in csv.DictReader(file)}
    figures = [float(table["noise_0.5"][f"reduction_percent{end}"]) for end in ("", "_min")]
    assert figures == pytest.approx([14.0, 13.0])
    assert (table["lost"]["not_in_control_reasons"], table["lost"]["safe"]) == ("STREAM_LOST 91", "True")


def test_an_unsafe_campaign_is_marked_before_anything_else(tmp_path, no_pictures) -> None:
    rows = rows_of(
        (scenario_of("bad"), [phase_of(broken=["period 3: jets_shut: <em>"])]),
        (scenario_of("worse"), [phase_of(failure="it diverged")]),
    )
    _, page = written(rows, tmp_path / "c")
    box = page.index('<p class="trouble" role="alert">1 of 3 scenarios safe')
    assert "UNSAFE: bad, worse" in page[box : page.index("<table>")]
    assert "phase 0: period 3: jets_shut: &lt;em&gt;" in page
    assert "did not finish: it diverged" in page
    assert re.findall(r'<p class="trouble">(.*)</p>', page) == ["Broken: 1 times.", "Not every run finished."]


def test_curves_take_the_scenarios_of_their_name_alone(some_rows) -> None:
    delays = curve(some_rows, r"delay_(\d+)")
    assert [(x, row.scenario.name) for x, row in delays] == [(0.0, "undisturbed"), (4.0, "delay_4")]
    axes = figures_of(some_rows)["delay"].axes[0]
    drawn = {str(one.get_label()): np.asarray(one[0].get_ydata()) for one in axes.containers}
    assert drawn["compensated"] == pytest.approx([20.0, 19.0])
    assert drawn["not compensated"] == pytest.approx([20.0, -5.0])
    (stars,) = (line for line in axes.lines if str(line.get_label()).startswith("paper"))
    # "a gradual increase from 0.918 (d = 0) to 0.950 (d = 12)", baseline 1.051.
    assert np.asarray(stars.get_xydata()).ravel() == pytest.approx([0, 12.65, 12, 9.61], abs=0.01)
    assert not {"noise", "delay"} & figures_of(some_rows[:1]).keys()


@pytest.mark.browser
@pytest.mark.proofs  # a browser; the page of a run has one
def test_the_page_opens_without_a_fault_for_all_readers(browser, some_rows, tmp_path, no_pictures) -> None:
    """With every verdict that a scenario can have."""
    bad = (scenario_of("bad", "Bus"), [phase_of(broken=["period 3: jets_shut"]), phase_of(failure="it diverged")])
    url = written((*some_rows, *rows_of(bad)[1:]), tmp_path / "c")[0].report.as_uri()
    for width, dark in ((1280, True), (PHONE, False)):
        seen = visit(browser, url, home=url, width=width, dark=dark)
        assert not seen.violations(), (width, dark)
        assert not seen.is_wider_than_its_window, (width, dark)
        assert not seen.troubles, (width, dark)
