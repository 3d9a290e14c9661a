"""The shipped release in the closed loop from several starting phases in the shedding cycle: figures with their spread.

    python -m benchmarks release-loop [--bundle BUNDLE] [--config FILE] [--json FILE]

Each run is computed as by `stillwake run`, over CAN and with ONNX Runtime in int8: 25 t_c without control and 100 t_c
with control. The last 60 t_c are averaged. For another body, give its settings and a release for this body.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from scipy.stats import sem
from scipy.stats import t as student_t

from benchmarks.common.command_line import LOOP, JsonFile, Parts, Phases, Release, Workers, kept_runs, made_from, report
from benchmarks.release.tables import release_loop
from contract.config.loading import load_config
from contract.config.tree import Config
from contract.release import bundle as bundles
from contract.release.checks import Bundle
from contract.results import versions
from contract.shipped import BUNDLE
from firmware_sim.bench.simulation import Simulation, Spans
from firmware_sim.campaign.folder import CampaignFolder, keep_states, phases_apart, starting_states
from firmware_sim.runs.run_log import RunLog
from firmware_sim.runs.summary import summary
from wake.truck.state import load_state
from wake.truck.truck_wake import TruckWake

SPANS: Final = Spans(lead_in=25.0, controlled=100.0, settle=40.0)
_MEASURED: Final = (
    *("Cd_uncontrolled", "abs_Cl_uncontrolled", "Cd_net_uncontrolled", "Cd_net_controlled"),
    *("jet_power_controlled", "trouble", *LOOP),
)
FIGURES: Final = (
    *("reduction_percent", "abs_Cl_controlled", "mean_Cl_controlled", "rms_action", "jet_power_controlled"),
    *("Cd_uncontrolled", "Cd_controlled", "Cd_net_uncontrolled", "Cd_net_controlled"),
    *("net_reduction_percent", "net_of_power_percent"),
)
"""Figures of a run for which the mean and the spread over all starting phases are computed."""


def main(
    json_file: JsonFile = None,
    parts: Parts = Path("runs/release_loop"),
    phases: Phases = 5,
    workers: Workers = 2,
    bundle: Release = BUNDLE,
    config_file: Annotated[Path | None, typer.Option("--config", help="Settings of body and flow (TOML).")] = None,
) -> None:
    """Run the closed loop from every starting phase and print a table."""
    release = bundles.load(bundle)
    config = replace(load_config(config_file), mpc=release.manifest.mpc)
    kept = kept_starts(parts, release, phases, config)
    runs = {kept.path / f"phase_{number}.json": (kept.start(number),) for number in range(phases)}
    rows = kept_runs(partial(measured, bundle, config), runs, workers=workers, label="release")
    over_phases = spread(rows)
    settings: dict[str, Any] = {
        "body": asdict(config.body),
        "flow": asdict(config.flow),
        "mpc": asdict(release.manifest.mpc),
    }
    settings["phases_t_c"] = [apart * config.flow.control_period for apart in phases_apart(phases, config)]
    facts = facts_of(release, SPANS, sensors=list(release.manifest.sensors), **settings)
    means = {name: found["mean"] for name, found in over_phases.items()}
    report(json_file, {**means, "phases": rows, "over_phases": over_phases}, facts, release_loop)


def facts_of(release: Bundle, spans: Spans | None = None, **others: Any) -> dict[str, Any]:
    """Return the facts of a measurement with a release: its name, digest and packages, the spans, and others."""
    of_spans = {} if spans is None else {name: getattr(spans, name) for name in ("lead_in", "controlled", "settle")}
    packages = versions("stillwake", "onnxruntime", "numpy", "numba")
    return {"bundle": release.manifest.name, "digest": release.digest, **of_spans, **others, "versions": packages}


def run_from(start: Path, release: Bundle, config: Config, spans: Spans = SPANS, **others: Any) -> RunLog:
    """Run the closed loop from the flow state in a file; `others` are arguments of `Simulation`."""
    wake = TruckWake(config.flow, body=config.body)
    wake.reset(load_state(start))
    return Simulation(release, config, spans=spans, **others).run(wake)


def kept_starts(parts: Path, release: Bundle, phases: int, config: Config) -> CampaignFolder:
    """Return a folder for a release's runs, with initial states at `phases` phases of the shedding cycle."""
    kept = CampaignFolder(parts / f"{made_from(release.digest)}_{phases}")
    kept.start(0).parent.mkdir(parents=True, exist_ok=True)
    keep_states(kept, starting_states(kept, config, phases))
    return kept


def with_net(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a run's figures and two further reductions in per cent, which include the costs of the jets: of `Cd_net`
    (wall, slot faces and the jets' momentum), and of the sum of `Cd_net` and the jets' power. The two can be added,
    because a drag with Cd = 1 costs `jet_power` = 1 at the vehicle's speed."""
    before, under = row["Cd_net_uncontrolled"], row["Cd_net_controlled"]
    return {
        **row,
        "net_reduction_percent": 100.0 * (1.0 - under / before),
        "net_of_power_percent": 100.0 * (1.0 - (under + row["jet_power_controlled"]) / before),
    }


def spread(rows: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, float]]:
    """Return mean, minimum and maximum of every figure over the starting phases, with several phases also the half
    width of the mean's 95 % confidence interval. The interval assumes independent starts, so it is too narrow if
    neighbouring starts give similar results."""
    found = {}
    for name in FIGURES:
        values = [row[name] for row in rows]
        found[name] = {"mean": sum(values) / len(values), "least": min(values), "most": max(values)}
        if len(values) > 1:
            found[name]["half_width_95"] = half_width_95(values)
    return found


def half_width_95(values: Sequence[float]) -> float:
    """Return the half width of the 95 % confidence interval of the mean by Student's t."""
    return float(sem(values) * student_t.ppf(0.975, len(values) - 1))


def measured(bundle: Path, config: Config, start: Path) -> dict[str, Any]:
    """Run from a starting state, and return the figures with the reductions that include the costs of the jets."""
    found = summary(run_from(start, bundles.load(bundle), config))
    return with_net({name: found[name] for name in _MEASURED})
