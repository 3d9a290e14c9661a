"""The paper's figures on control, for a release: errors of its forecasts, distributions, and mean fields.

    python -m benchmarks release-figures [--json FILE]

The benchmark runs the closed loop as `stillwake run` does, stores every forecast of the controller, and averages the
flow without and with control. Pictures are written to docs/pictures.

A forecast assumes that the jets follow the optimiser's plan, but later control steps may change the plan from its
second action on.
"""

from contextlib import nullcontext
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.common.command_line import JsonFile, bars, report
from benchmarks.common.documents import draw
from benchmarks.release import release_drawings, tables
from benchmarks.release.release_loop import SPANS
from contract.arrays import Array
from contract.config.loading import load_config
from contract.controller.interface import ControlStep, RunnableController
from contract.runtime.onnx_session import OnnxController
from firmware_sim.bench.closed_loop import run_closed_loop
from firmware_sim.runs.run_log import Row, RunFolder, RunLog
from stillwake.console.progress import progress
from stillwake.parts.releases import open_release
from wake.plants import own_wake
from wake.solver.grid import Flow
from wake.truck.develop import recirculation_length
from wake.truck.truck_wake import TruckWake

CASES: Final = ("uncontrolled", "controlled")
RUN: Final = Path("runs/release_figures")


class Listening:
    """A controller that passes every call to an inner controller and stores the result of the latest step."""

    def __init__(self, inner: RunnableController) -> None:
        self.inner, self.description = inner, inner.description
        self.latest: ControlStep | None = None

    def warm_up(self, steps: int) -> None:
        self.inner.warm_up(steps)

    def control_step(self, *given: Any, **named: Any) -> ControlStep:
        self.latest = self.inner.control_step(*given, **named)
        return self.latest


def main(json_file: JsonFile = None) -> None:
    """Run the closed loop once, and write figures and pictures."""
    release, config = open_release(None), load_config()
    horizon, period = release.manifest.mpc.horizon, config.flow.control_period
    listening, forecasts = Listening(OnnxController.of(release)), list[Array]()
    first, settled = round(SPANS.lead_in / period), round((SPANS.lead_in + SPANS.settle) / period)
    wake = own_wake(config)
    with progress("periods", console=bars) as shown:
        flows, counts = [Flow.zeros(wake.grid.shape) for _ in range(2)], [0, 0]

        def show(row: Row, done: int, total: int) -> None:
            step, listening.latest = listening.latest, None
            forecasts.append(np.full((horizon, 2), np.nan) if step is None else step.forces)
            if done <= first or done > settled:
                case = done > first
                counts[case] += 1
                flows[case].flat[:] += (wake.flow.flat - flows[case].flat) / counts[case]
            shown("closed loop", done, total, f"Cd {row.sample.Cd:.3f}")

        plant = nullcontext(wake)
        log = run_closed_loop(RUN, release, config, SPANS, controller=listening, plant=plant, progress=show)
    figures = measured(log, np.array(forecasts), settled) | {"mean": [_mean(wake, flow) for flow in flows]}
    facts = {
        "bundle": {"name": release.manifest.name, "digest": release.digest},
        **{name: getattr(SPANS, name) for name in ("lead_in", "controlled", "settle")},
        "period": period,
        "versions": log.metadata.versions,
    }
    report(json_file, figures, facts, tables.release_forecasts, tables.release_distributions)
    drawn = release_drawings.drawn(figures) | {"release_mean_flow": release_drawings.mean_flows(wake, flows)}
    # Without a results file, the pictures state the run's summary as their source.
    draw(drawn, RunFolder(RUN).summary if json_file is None else json_file.resolve())


def measured(log: RunLog, forecasts: Array, settled: int) -> dict[str, Any]:
    """Return the errors of the forecasts, and the distributions, for a run of n periods. `forecasts` are the forces
    forecast in every period for the next H periods, shape (n, H, 2), NaN without a forecast; `settled` is the index of
    the first row of the evaluated part with control."""
    truth = np.column_stack([log.series["Cd"], log.series["Cl"]])
    errors = forecast_errors(forecasts[settled:], truth[settled:])
    spans = (slice(0, log.enabled_at), slice(settled, len(truth)))
    return {
        "forecast": [_errors(h, found) for h, found in enumerate(errors, start=1)],
        "sigma": {"uncontrolled": {name: float(truth[spans[0], i].std()) for i, name in enumerate(("drag", "lift"))}},
        "base_Cp": _distribution([log.series["base_Cp"][span] for span in spans]),
        "Uy": _distribution([log.series["Uy_probe"][span] for span in spans]),
    }


def forecast_errors(forecasts: Array, truth: Array) -> list[Array]:
    """Return |forecast - truth| at each h = 1 .. H, as an array of shape (m_h, 2) for the m_h comparable forecasts. Row
    k of the forecasts, shape (n, H, 2), is for the periods k + 1 .. k + H; NaN if missing. `truth`: (n, 2)."""
    found = []
    for ahead in range(1, forecasts.shape[1] + 1):
        error = np.abs(forecasts[: len(truth) - ahead, ahead - 1] - truth[ahead:])
        found.append(error[~np.isnan(error).any(axis=1)])
    return found


def _errors(ahead: int, found: Array) -> dict[str, Any]:
    low, high = np.quantile(found, (0.1, 0.9), axis=0)
    return {
        "h": ahead,
        **{
            name: {"mean": float(found[:, i].mean()), "p10": float(low[i]), "p90": float(high[i])}
            for i, name in enumerate(("drag", "lift"))
        },
    }


def _distribution(values: list[Array]) -> dict[str, Any]:
    # The bins cover the common range of the cases without and with control.
    edges = np.histogram_bin_edges(np.concatenate(values), 40)
    return {
        "edges": edges.tolist(),
        **{
            case: {
                "density": np.histogram(one, edges, density=True)[0].tolist(),
                "mean": float(one.mean()),
                "std": float(one.std()),
            }
            for case, one in zip(CASES, values, strict=True)
        },
    }


def _mean(wake: TruckWake, flow: Flow) -> dict[str, Any]:
    length, cp = recirculation_length(wake.grid, flow), wake.surface.measure(flow).Cp
    return {"recirculation_length": length, "Cp": np.asarray(cp).tolist()}
