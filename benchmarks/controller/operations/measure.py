"""Roads to fewer operations in a control step, one by one: what they cost, and how good their plans are.

    python -m benchmarks operations [--model DIR] [--dataset H5] [--json FILE]

Each road plans through recordings under control as the ECU does, from its own last plan and for the next control
period; the jets are the recording's. Constants of a road are chosen, and its averages and networks made, on the first
round of recordings; the gaps are those of the second round. A gap is the cost above the lowest one found, as a share of
what that gains over a plan of zeros. Roads that look good close the loop, in NumPy's float64; these runs are kept.

Milliseconds are modelled for the control step in C with int8 weights on a Cortex-M7 at 480 MHz: cycles of a row of the
encoder, of an iteration and of the last roll-out, from libraries that differ by one of these.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
import torch
import typer
from rich.table import Table

from benchmarks.common.command_line import MODEL, Dataset, JsonFile, Model, Parts, console, save, track
from benchmarks.common.commands import LOOP
from benchmarks.common.parts import part
from benchmarks.controller.operations.chosen import IN_THE_LOOP, RELEASE, average_curvature, chosen_roads
from benchmarks.controller.operations.road import Road, adam
from benchmarks.controller.operations.sequences import Sequences, gaps, optima, zero_costs
from benchmarks.controller.operations.travelling import TravellingController
from benchmarks.controller.operations.warm_start import learn
from benchmarks.controller.situations import LEAD
from contract.arrays import Array
from contract.config.learning import ModelConfig
from contract.config.loading import load_config
from contract.model import model_folder
from contract.recording import dataset
from contract.release import bundle as bundles
from contract.results import versions
from contract.shipped import BUNDLE, RECORDING
from export.program.controller_program import ControllerProgram
from export.program.from_training import program_of
from export.program.random_program import random_program, random_window
from export.release.lowering import int8_library
from firmware_sim.bench.simulation import simulate
from firmware_sim.bench.spans import Spans
from firmware_sim.mcu.measure import measure
from firmware_sim.runs.summary import summary
from wake.truck.state import developed_state
from wake.truck.truck_wake import TruckWake

_SPANS: Final = Spans(lead_in=25.0, controlled=100.0, settle=40.0)
_EVERY: Final = 12
"""Control steps between situations that an optimum is found for."""
_SETTLED: Final = 200
"""Windows of a recording that are left out: the controller has just begun."""


def main(
    json_file: JsonFile = None,
    model: Model = MODEL,
    data: Dataset = RECORDING,
    parts: Parts = Path("runs/operations"),
    stretches: Annotated[int, typer.Option(min=1, help="Of an episode.")] = 6,
    seed: Annotated[int, typer.Option(help="Of the warm start.")] = 0,
) -> None:
    """Choose, teach, measure, close loops, print a table."""
    torch.set_num_threads(1)
    trained = model_folder.read(model)
    program = program_of(trained, load_config().mpc)
    weights = np.array(program.mpc.weights.as_tuple())
    recorded = dataset.read(data)
    first, second = (
        [episode for episode in recorded.episodes if episode.name.startswith(f"controlled_{number}")]
        for number in (1, 2)
    )
    cycles = m7_cycles(program)
    proposal = learn(Sequences.of(program, first, 12, 50), RELEASE, weight_sets=12, passes=4, seed=seed)
    curvature = average_curvature(Sequences.of(program, first, 3, LEAD + 30, _SETTLED), weights)
    roads = chosen_roads(curvature, proposal)
    folder = parts / trained.weights_sha256[:12]
    folder.mkdir(parents=True, exist_ok=True)
    given = Sequences.of(program, second, stretches, LEAD + 4 * _EVERY, _SETTLED)
    rows = part(folder / f"gaps_{stretches}_{seed}.json", partial(measured, given, roads, weights))
    for row, road in zip(rows, roads, strict=True):
        row["multiply_accumulates"] = road.multiply_accumulates(program)
        row["modelled_ms_480"] = modelled_cycles(road, program, cycles) / 480e3
    closing = [
        (row, road) for row, road in zip(rows, roads, strict=True) if (road.name, road.iterations) in IN_THE_LOOP
    ]
    for row, road in track(closing, "loops", "loops"):
        name = f"{road.name}_{road.iterations}.json".replace(" ", "_").replace(",", "")
        row["loop"] = part(folder / name, partial(loop, program, road))
    figures = {"roads": rows, "encoder": encoder(program, cycles)}
    _print(rows)
    facts = {
        "weights_sha256": trained.weights_sha256,
        "horizon": program.mpc.horizon,
        "stretches": stretches * len(second),
        "episodes": [episode.name for episode in second],
        "chosen_on": [episode.name for episode in first],
        "lead_in": _SPANS.lead_in,
        "controlled": _SPANS.controlled,
        "settle": _SPANS.settle,
        "m7_cycles": cycles,
        "seed": seed,
        "versions": versions("stillwake", "numpy", "scipy", "torch", "ziglang", "unicorn"),
    }
    save(json_file, figures=figures, facts=facts)


def measured(sequences: Sequences, roads: Sequence[Road], weights: Array) -> list[dict[str, Any]]:
    """Gaps of every road, in per cent."""
    times = range(LEAD, len(sequences.z), _EVERY)
    found, plans = [], []
    for road in track(roads, "roads", "roads"):
        travelled = list(sequences.travelled(road, weights))
        found.append([travelled[k][0].cost(travelled[k][1]) for k in times])
        plans.append([travelled[k][1] for k in times])
    optimum = optima(sequences, times, np.array(plans), weights)
    zero = zero_costs(sequences, times, weights)
    rows = []
    for road, costs in zip(roads, found, strict=True):
        gap = 100.0 * gaps(np.array(costs), zero, optimum)
        rows.append(
            {
                "name": road.name,
                "iterations": road.iterations,
                "rate": road.rate,
                "gap": float(gap.mean()),
                "gap_p95": float(np.percentile(gap, 95)),
                "situations": gap.size,
            }
        )
    return rows


def m7_cycles(program: ControllerProgram) -> dict[str, float]:
    """Of a row of the encoder, an iteration, and what a control step takes beside them: a roll-out, mostly."""
    found = {}
    for window, iterations in ((program.window, 3), (program.window, 1), (1, 3)):
        about = ModelConfig(
            window=window,
            dynamics_width=program.dynamics.hidden.weight.shape[0],
            decoder_width=program.decoder.output.weight.shape[1],
        )
        like = random_program(0, model=about, mpc=replace(program.mpc, iterations=iterations))
        rng = np.random.default_rng(0)
        windows = [random_window(like, rng) for _ in range(20)]
        found[window, iterations] = measure(int8_library(like, windows), windows[0].astype(np.float32)).cycles
    row = (found[program.window, 3] - found[1, 3]) / (program.window - 1)
    iteration = (found[program.window, 3] - found[program.window, 1]) / 2.0
    return {"row": row, "iteration": iteration, "rest": found[1, 3] - row - 3.0 * iteration}


def modelled_cycles(road: Road, program: ControllerProgram, cycles: Mapping[str, float]) -> float:
    """Of a control step; what is beside the passes counts as much a product as an iteration does."""
    adam_alone = replace(road, rule=adam)
    rollouts, iterations = road.passes()
    of_passes = adam_alone.multiply_accumulates(program)
    longer = replace(adam_alone, iterations=iterations + 1).multiply_accumulates(program)
    beside = (road.multiply_accumulates(program) - of_passes) * cycles["iteration"] / (longer - of_passes)
    of_rollouts = (rollouts - iterations) * cycles["rest"]
    return program.window * cycles["row"] + iterations * cycles["iteration"] + of_rollouts + beside


def encoder(program: ControllerProgram, cycles: Mapping[str, float]) -> dict[str, float]:
    """What a state carried from row to row would save of the release's control step."""
    whole = RELEASE.multiply_accumulates(program)
    row = program.encoder.lstm.weight_input.size + program.encoder.lstm.weight_recurrent.size
    return {
        "window": program.window * row,
        "streamed": row,
        "saved_share": (program.window - 1) * row / whole,
        "saved_ms_480": (program.window - 1) * cycles["row"] / 480e3,
        "step_ms_480": modelled_cycles(RELEASE, program, cycles) / 480e3,
    }


def loop(program: ControllerProgram, road: Road) -> dict[str, float]:
    """What `summary` finds of the wake under this road."""
    config, release = load_config(), bundles.load(BUNDLE)
    controller = TravellingController(program, road)
    wake = TruckWake(config.flow, body=config.body)
    wake.reset(developed_state())
    log = simulate(release, config, spans=_SPANS, wake=wake, controller=controller)
    found = summary(log)
    return {name: float(found[name]) for name in LOOP}


def _print(rows: Sequence[Mapping[str, Any]]) -> None:
    table = Table("road", "iterations", "gap, %", "95 %", "M MAC", "ms at 480 MHz", "less drag, %", "mean |Cl|")
    for row in rows:
        closed = row.get("loop")
        table.add_row(
            row["name"],
            str(row["iterations"]),
            f"{row['gap']:.1f}",
            f"{row['gap_p95']:.1f}",
            f"{row['multiply_accumulates'] / 1e6:.2f}",
            f"{row['modelled_ms_480']:.2f}",
            *((f"{closed['reduction_percent']:.2f}", f"{closed['abs_Cl_controlled']:.3f}") if closed else ("", "")),
        )
    console.print(table)
