"""The report of a campaign: one self-contained HTML page with a table of the results, curves, and a section for each
group of scenarios. Separate files contain the table and the figures too."""

from datetime import date
from itertools import groupby
from typing import Final

from contract.atomic import replacing
from contract.config import loading
from firmware_sim.campaign import matrix_words, result_figures
from firmware_sim.campaign.conduct import Campaign, Result
from firmware_sim.campaign.folder import CampaignFolder
from firmware_sim.campaign.matrix_words import criteria_text
from firmware_sim.campaign.result_figures import PAPERS_DELAYED_CD, PAPERS_NOISE, PAPERS_UNCONTROLLED_CD
from firmware_sim.campaign.scenario import Criteria
from firmware_sim.runs import pages
from firmware_sim.runs.metadata import leaves

_BARS: Final = "Bars: smallest and largest value of several starts."
_CURVES: Final = {
    "noise": (
        "Sensor noise",
        f"{_BARS} Star: the paper's loop without noise. For noise the paper states "
        f"{PAPERS_NOISE!r} and shows a picture without numbers.",
    ),
    "delay": (
        "Actuator delay",
        f"{_BARS} Stars: the paper's loop with compensation. Mean Cd is "
        f"{PAPERS_DELAYED_CD[0]:.3f} without delay, {PAPERS_DELAYED_CD[12]:.3f} with 12 periods of delay, and "
        f"{PAPERS_UNCONTROLLED_CD:.3f} without control (appendix B). The paper states no side force in numbers.",
    ),
    "overview": ("Overview", _BARS),
}
_USED: Final = ("operating_point", "flow", "bus", "ecu", "vehicle")
"""Sections of the settings that the runs use."""


def write_report(folder: CampaignFolder, campaign: Campaign, result: Result, day: date) -> None:
    """Write the page, the table and the figures into the folder, each completely or not at all."""
    matrix_words.write_csv(folder.table, result.rows)
    pictures = {name: pages.png_of(figure) for name, figure in result_figures.figures_of(result.rows).items()}
    for name, png in pictures.items():
        with replacing(folder.figures / f"{name}.png") as temporary:
            temporary.write_bytes(png)
    manifest, tree = campaign.bundle.manifest, loading.to_tree(campaign.config)
    pages.write(
        folder.report,
        "campaign.html.j2",
        "firmware_sim.campaign",
        day=day.isoformat(),
        controller=f"{manifest.name} ({manifest.precision}, {campaign.bundle.digest[:12]})",
        phases=campaign.phases,
        seed=campaign.seed,
        controlled=campaign.timing.controlled,
        settle=campaign.timing.settle,
        reynolds=campaign.config.flow.reynolds,
        safe=result.safe,
        headline=matrix_words.headline(result.rows),
        heads=matrix_words.MATRIX_HEADS,
        criteria=criteria_text(Criteria()),
        words_of=criteria_text,
        groups=[
            (title, [(row, matrix_words.cells(row)) for row in rows])
            for title, rows in groupby(result.rows, lambda row: row.scenario.group)
        ],
        curves=[(_CURVES[name][0], pages.data_uri(png), _CURVES[name][1]) for name, png in pictures.items()],
        settings=[f"{name} = {value}" for name, value in leaves({name: tree[name] for name in _USED})],
    )
