"""What a weight of the cost changes under the shipped release: side force, jets and drag, in the closed loop.

    python -m benchmarks weights [--json FILE]

On the mesh that the prior is trained on, through CAN and ECU, int8: 15 t_c without and 85 with control, of which the
last 50 count. One weight at a time has another value than the release's.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Any, Final

from matplotlib.figure import Figure
from rich.table import Table

from benchmarks.common.command_line import JsonFile, console, save, track
from benchmarks.common.commands import LOOP
from contract.config.loading import load_config
from contract.release import bundle as bundles
from contract.results import versions
from contract.shipped import BUNDLE
from firmware_sim.bench.simulation import Simulation
from firmware_sim.bench.spans import Spans
from firmware_sim.ecu.calibrating import release_calibration
from firmware_sim.runs.summary import summary
from stillwake.parts.differentiable_wake import mesh_of
from wake.solver.grid import box_grid
from wake.truck.regrid import SETTLE_TIME, moved
from wake.truck.state import State, developed_state
from wake.truck.truck_wake import TruckWake

SPANS: Final = Spans(lead_in=15.0, controlled=85.0, settle=35.0)
TRIED: Final = {"lift": (0.0, 0.2, 0.4, 0.8, 1.6), "effort": (0.0, 20.0, 50.0, 100.0)}
"""Values by weight."""


def main(json_file: JsonFile = None) -> None:
    """Run every value and print a table."""
    cases = [(name, value) for name, values in TRIED.items() for value in values]
    rows = [{"weight": name, "value": value, **outcome(name, value)} for name, value in track(cases, "weights", "runs")]
    table = Table("weight", "value", "less drag, %", "mean |Cl|", "rms action")
    for row in rows:
        found = (f"{row[name]:.4g}" for name in ("reduction_percent", "abs_Cl_controlled", "rms_action"))
        table.add_row(row["weight"], f"{row['value']:g}", *found)
    console.print(table)
    release = bundles.load(BUNDLE)
    facts = {
        "bundle": release.manifest.name,
        "digest": release.digest,
        **{name: getattr(SPANS, name) for name in ("lead_in", "controlled", "settle")},
        "mesh": mesh_of(load_config()).flow.refinement,
        "versions": versions("stillwake", "onnxruntime", "numpy", "numba"),
    }
    save(json_file, figures=rows, facts=facts)


def outcome(name: str, value: float, spans: Spans = SPANS) -> dict[str, Any]:
    """Figures of a run with another value of a weight."""
    release, config = bundles.load(BUNDLE), mesh_of(load_config())
    own = release_calibration(release, config)
    other = replace(own, weights=replace(own.weights, **{name: value}))
    wake = TruckWake(config.flow, body=config.body)
    wake.reset(_start())
    found = summary(Simulation(release, config, spans=spans, calibration=other).run(wake))
    return {key: found[key] for key in (*LOOP, "Cd_uncontrolled")}


@cache
def _start() -> State:
    config = mesh_of(load_config())
    wake = TruckWake(config.flow, body=config.body)
    return moved(developed_state(), box_grid(config.body.length), wake, SETTLE_TIME)


def drawn(rows: list[Mapping[str, Any]]) -> dict[str, Figure]:
    """The picture of `docs/explanation/through-the-flow.md`."""
    figure = Figure(figsize=(8.0, 3.0), layout="constrained")
    shown = (("lift", "abs_Cl_controlled", "mean |Cl|"), ("effort", "rms_action", "rms action, U_inf W"))
    for axes, (weight, name, label) in zip(figure.subplots(1, 2), shown, strict=True):
        found = [row for row in rows if row["weight"] == weight]
        values = [row["value"] for row in found]
        heights = [row[name] for row in found]
        axes.plot(values, heights, "o-", color="tab:blue")
        axes.set(xlabel=f"weight on {weight}", ylabel=label, ylim=(0.0, 1.15 * max(heights)))
        drag = axes.twinx()
        drag.plot(values, [row["reduction_percent"] for row in found], "s--", color="tab:orange")
        drag.set(ylabel="less drag, %", ylim=(0.0, 40.0))
        drag.yaxis.label.set_color("tab:orange")
        axes.yaxis.label.set_color("tab:blue")
    return {"weights": figure}
