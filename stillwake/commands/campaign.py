"""The command `stillwake campaign`, which runs the closed loop under every disturbance of a test plan."""

from collections.abc import Mapping
from dataclasses import replace
from datetime import date
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer
from rich.text import Text

from contract.config.tree import Config
from contract.errors import StillwakeError
from contract.release.checks import Bundle
from contract.results import versions
from stillwake.console import options as shared
from stillwake.console.outputs import check_json, claim, save_json
from stillwake.console.progress import progress
from stillwake.console.settings import settings
from stillwake.console.stopping import go_on_with
from stillwake.console.terminal import console, print_table
from stillwake.parts.releases import describe, open_release

if TYPE_CHECKING:
    from firmware_sim.campaign.conduct import Campaign, Result
    from firmware_sim.campaign.folder import CampaignFolder

_USES: Final = ("operating_point", "flow", "bus", "ecu", "vehicle")
_LONGEST: Final = 1e6
"""Longest time in t_c that an option accepts, about a day on the road."""

Scenarios = Annotated[list[Path], typer.Option(help="TOML file with your own scenarios (repeatable).", metavar="FILE")]
Only = Annotated[list[str], typer.Option(help="Only these scenarios, e.g. 'noise_*' (repeatable).", metavar="GLOB")]
Phases = Annotated[int, typer.Option(help="Number of starting phases in a shedding cycle.", min=1, max=25)]
Settle = Annotated[float, typer.Option(help="Time with control before the averages begin, t_c.", min=0.0, max=_LONGEST)]


def campaign(
    output: Annotated[
        Path | None, typer.Argument(help="Folder to write; a campaign that was stopped there is continued.")
    ] = None,
    scenarios: Scenarios = [],  # noqa: B006  (typer reads it, nothing writes it)
    only: Only = [],  # noqa: B006
    list_them: Annotated[bool, typer.Option("--list", help="Print the test plan, and run nothing.")] = False,
    phases: Phases = 3,
    controlled: Annotated[float, typer.Option(help="Time with control, t_c.", min=0.2, max=_LONGEST)] = 60.0,
    settle: Settle = 20.0,
    seed: shared.Seed = 0,
    workers: shared.Workers = None,
    bundle: shared.Bundle = None,
    overwrite: shared.Overwrite = False,
    json_file: shared.JsonFile = None,
    given: shared.Settings = [],  # noqa: B006
) -> None:
    """Run a test plan: the closed loop with noise, delay, faults of sensors and of the bus, and a changed flow. Each
    disturbance is run from several starting phases of the wake.

    The command writes a table, figures and one page into the folder. It can be stopped at any time: finished runs are
    stored, and the same command continues the campaign. A call with another seed, bundle, duration or setting is
    another campaign. With --phases 1 --controlled 40 the command is a quick trial, whose figures are not significant.

    Exit status 3: a scenario violated an invariant, which is a condition for safe frames and jet flows. A scenario
    without drag reduction is not a failure.
    """
    from firmware_sim.campaign.folder import CampaignFolder
    from firmware_sim.campaign.judgement import listing

    if output is None and not list_them:
        raise StillwakeError("name the folder to write, or give --list to see the test plan")
    spread = shared.workers_of(workers)
    config = settings("campaign", given, uses=_USES).config
    release = open_release(bundle)
    spans = {"controlled": controlled, "settle": settle}
    planned = _planned(release, config, scenarios, only, spans, phases, seed)
    if list_them or output is None:
        console.print(*listing(planned.scenarios, phases=planned.phases), sep="\n")
        return
    folder = CampaignFolder(output)
    claim(output, folder=True)
    folder.check(planned.label(), overwrite=overwrite)
    # This check is after the folder's check, because the file may be in the folder.
    check_json(json_file, *scenarios, *vars(folder).values())
    console.print(*describe(release), sep="\n")
    result = _conducted(planned, folder, spread)

    from firmware_sim.campaign.report import write_report

    write_report(folder, planned, result, date.today())
    facts = {
        **planned.label(),
        "bundle_name": release.manifest.name,
        "versions": versions("stillwake", "numpy", "numba"),
        "runs": {"made": result.made, "kept": result.kept},
    }
    save_json(json_file, figures=[row.figures() for row in result.rows], facts=facts)
    _print(result)
    console.print(f"wrote {folder.report} and {folder.table}")
    if not result.safe:
        raise typer.Exit(3)


def _planned(
    release: Bundle, config: Config, files: list[Path], only: list[str], spans: dict[str, float], phases: int, seed: int
) -> "Campaign":
    from contract.config.body import layout_of
    from ecu.fit import check_flow, check_sensors
    from firmware_sim.bench.simulation import Spans
    from firmware_sim.campaign.conduct import MARGIN_PERIODS, Campaign
    from firmware_sim.campaign.scenario import Place, selected, whole_plan

    check_flow(release, config.flow)
    layout = layout_of(config.body)
    check_sensors(release, layout)
    sensors = release.manifest.sensors
    on_base = {layout.names[column] for column in layout.base}
    # Before control is requested, the controller's window fills with the readings of the disturbed sensors.
    lead_in = release.manifest.window + MARGIN_PERIODS
    place = Place(
        sensors=sensors,
        base_sensor=next((name for name in sensors if name in on_base), None),
        enabled_s=lead_in * config.period_ns / 1e9,
        t_c_s=config.operating_point.convective_time,
    )
    campaign = Campaign(
        scenarios=selected(whole_plan(files, place), only),
        bundle=release,
        config=replace(config, mpc=release.manifest.mpc),
        timing=Spans(averages=False, lead_in=lead_in * config.flow.control_period, **spans),
        phases=phases,
        seed=seed,
    )
    campaign.check()
    return campaign


def _conducted(planned: "Campaign", folder: "CampaignFolder", spread: Mapping[str, Any]) -> "Result":
    from firmware_sim.campaign.conduct import conduct

    def advice() -> str:
        return f"{folder.path} holds {n} finished runs; the same command continues" if (n := folder.finished) else ""

    # A run takes half a minute, so the rate of finished runs is averaged over the last hour.
    with go_on_with(advice), progress("runs", estimate_over=3600.0) as report:
        report("the starts", 0)

        def show(done: int, total: int, name: str) -> None:
            report("campaign" if total else "the starts", done, total or None, name)

        return conduct(planned, folder, **spread, progress=show)


def _print(result: "Result") -> None:
    """Print the table of the scenarios, then the headline, because a terminal shows the end of the output."""
    from firmware_sim.campaign.judgement import MATRIX_HEADS, cells, headline

    rows = []
    for row in result.rows:
        styles = ["", "green" if row.safe else "bold red", {"useful": "blue", "marginal": "yellow"}.get(row.use, "red")]
        rows.append([Text(word, style=style) for word, style in zip_longest(cells(row), styles, fillvalue="")])
    print_table(*MATRIX_HEADS, rows=rows)
    if result.kept:
        console.print(f"{result.made} runs computed, {result.kept} read from the folder")
    console.print(headline(result.rows))
    for row in result.rows:
        for text in row.broken:
            console.print(f"{row.scenario.name}: {text}", style="bold red")
