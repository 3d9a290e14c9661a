"""The shipped release in the closed loop from several starting phases in the shedding cycle: figures with their spread.

    python -m benchmarks release-loop [--bundle BUNDLE] [--config FILE] [--json FILE]

Each run is computed as by `stillwake run`, over CAN and with ONNX Runtime in int8: 25 t_c without control and 100 t_c
with control, the last 60 of which are averaged. For another body, give its settings together with a release for this
body; the body's wake is then first developed from fluid at rest. Finished runs are stored.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from rich.table import Table
from scipy.stats import sem
from scipy.stats import t as student_t

from benchmarks.common.command_line import JsonFile, Parts, console, save, track
from benchmarks.common.commands import LOOP
from benchmarks.common.parts import part
from contract.config.loading import load_config
from contract.config.tree import Config
from contract.controller.calibration import Calibration
from contract.release import bundle as bundles
from contract.release.checks import Bundle
from contract.results import versions
from contract.shipped import BUNDLE
from contract.side_by_side import process_pool
from firmware_sim.bench.simulation import Simulation
from firmware_sim.bench.spans import Spans
from firmware_sim.campaign.folder import CampaignFolder
from firmware_sim.campaign.starts import keep_states, phases_apart, starting_states
from firmware_sim.runs.summary import summary
from wake.truck.state import load_state
from wake.truck.truck_wake import TruckWake

SPANS: Final = Spans(lead_in=25.0, controlled=100.0, settle=40.0)
MOST_WORKERS: Final = 2
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
    phases: Annotated[int, typer.Option(min=1, max=25, help="Number of starts, spread over a shedding cycle.")] = 5,
    workers: Annotated[int, typer.Option(min=1, max=MOST_WORKERS, help="Processes, a run each at a time.")] = 2,
    bundle: Annotated[Path, typer.Option(help="Another release in place of the shipped one.")] = BUNDLE,
    config_file: Annotated[Path | None, typer.Option("--config", help="Settings of its body and flow (TOML).")] = None,
) -> None:
    """Run the closed loop from every starting phase and print a table."""
    release = bundles.load(bundle)
    config = replace(load_config(config_file), mpc=release.manifest.mpc)
    kept = kept_starts(parts, release, phases, config)
    rows = list(track(_runs(bundle, config, kept, phases, workers), "release", "runs", total=phases))
    over_phases = spread(rows)
    _print(rows, over_phases)
    facts = {
        "bundle": release.manifest.name,
        "digest": release.digest,
        "sensors": list(release.manifest.sensors),
        "body": asdict(config.body),
        "flow": asdict(config.flow),
        "mpc": asdict(release.manifest.mpc),
        **{name: getattr(SPANS, name) for name in ("lead_in", "controlled", "settle")},
        "phases_t_c": [apart * config.flow.control_period for apart in phases_apart(phases, config)],
        "versions": versions("stillwake", "onnxruntime", "numpy", "numba"),
    }
    means = {name: found["mean"] for name, found in over_phases.items()}
    save(json_file, figures={**means, "phases": rows, "over_phases": over_phases}, facts=facts)


def kept_starts(parts: Path, release: Bundle, phases: int, config: Config) -> CampaignFolder:
    """Return a folder for the runs of a release, which contains initial states at `phases` phases of the shedding
    cycle."""
    kept = CampaignFolder(parts / f"{release.digest[:12]}_{phases}")
    kept.start(0).parent.mkdir(parents=True, exist_ok=True)
    keep_states(kept, starting_states(kept, config, phases))
    return kept


def with_net(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a run's figures and two further reductions in per cent, which include the costs of the jets.

    `net_reduction_percent` is the reduction of `Cd_net`, which includes wall, slot faces and the jets' momentum.
    `net_of_power_percent` is the reduction of the sum of `Cd_net` and the jets' power. The two can be added, because at
    the vehicle's speed a unit of `jet_power` is the power of a unit of Cd.
    """
    before, under = row["Cd_net_uncontrolled"], row["Cd_net_controlled"]
    return {
        **row,
        "net_reduction_percent": 100.0 * (1.0 - under / before),
        "net_of_power_percent": 100.0 * (1.0 - (under + row["jet_power_controlled"]) / before),
    }


def spread(rows: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, float]]:
    """Return mean, minimum and maximum over the starting phases, for every figure that the runs of all phases have.

    With several phases the result also has the half width of the mean's 95 % confidence interval by Student's t. The
    interval assumes independent starts; it is too narrow if neighbouring starts give similar results.
    """
    found = {}
    for name in FIGURES:
        values = [row[name] for row in rows]
        if None in values:
            continue
        found[name] = {"mean": sum(values) / len(values), "least": min(values), "most": max(values)}
        if len(values) > 1:
            found[name]["half_width_95"] = float(sem(values) * student_t.ppf(0.975, len(values) - 1))
    return found


def _runs(bundle: Path, config: Config, kept: CampaignFolder, phases: int, workers: int) -> Iterator[dict[str, Any]]:
    files = [kept.path / f"phase_{number}.json" for number in range(phases)]
    starts = [kept.start(number) for number in range(phases)]
    missing = sum(not file.is_file() for file in files)
    # A process takes seconds to start, so none is started if the results of all runs are stored.
    with nullcontext() if missing == 0 else process_pool(min(workers, missing)) as pool:
        each = partial(_kept_run, bundle, config)
        yield from map(each, files, starts) if pool is None else pool.map(each, files, starts)


def _kept_run(bundle: Path, config: Config, file: Path, start: Path) -> dict[str, Any]:
    found: dict[str, Any] = part(file, lambda: measured(bundles.load(bundle), config, start))
    return found


def measured(release: Bundle, config: Config, start: Path, calibration: Calibration | None = None) -> dict[str, Any]:
    """Run from a starting state, and return the figures with the reductions that include the costs of the jets."""
    wake = TruckWake(config.flow, body=config.body)
    wake.reset(load_state(start))
    found = summary(Simulation(release, config, spans=SPANS, calibration=calibration).run(wake))
    return with_net({name: found[name] for name in _MEASURED})


def _print(rows: Sequence[Mapping[str, Any]], over_phases: Mapping[str, Mapping[str, float]]) -> None:
    table = Table(
        "phase", "less drag, %", "mean |Cl|", "mean Cl", "rms action", "jet power", "less Cd_net, %", "net, %"
    )
    shown = (*FIGURES[:5], "net_reduction_percent", "net_of_power_percent")
    named = [(str(number), row) for number, row in enumerate(rows)]
    for kind in ("mean", "half_width_95", "least", "most"):
        named.append((kind, {name: found.get(kind) for name, found in over_phases.items()}))
    for label, row in named:
        table.add_row(label, *("" if row.get(name) is None else f"{row[name]:.3f}" for name in shown))
    console.print(table)
