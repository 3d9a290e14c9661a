"""What a sine without feedback does to the wake: the alternative that needs no model, no sensors and no ECU.

    python -m benchmarks open-loop [--json FILE] [--frequency 0.20 ...]

Full amplitude, begun at two phases of the shedding cycle: the wake locks onto one of several states, and which one
depends on that. Averages leave out the settling time and hold whole cycles: of the
sine, or without one of the lift. The figures are those of a closed-loop run, so that both can be in one table.
"""

from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Table

from benchmarks.common.command_line import JsonFile, console, save, track
from contract import sensors
from contract.arrays import Array
from contract.results import versions
from wake.plant.sample import Sample
from wake.truck.averages import over_cycles, over_last_cycles
from wake.truck.state import developed_state
from wake.truck.truck_wake import TruckWake

FREQUENCIES = (0.18, 0.19, 0.20, 0.21)
LEADS = (0, 12)
"""Control steps without forcing before the sine begins; a shedding cycle has 25."""


def main(
    json_file: JsonFile = None,
    frequency: Annotated[list[float], typer.Option(help="Forcing frequency in 1/t_c.")] = list(FREQUENCIES),  # noqa: B006
    lead: Annotated[list[int], typer.Option(help="Control steps before the sine begins.")] = list(LEADS),  # noqa: B006
    controlled: Annotated[float, typer.Option(help="Duration, t_c.")] = 100.0,
    settle: Annotated[float, typer.Option(help="Left out of the averages, t_c.")] = 40.0,
) -> None:
    """Run each frequency and print a table."""
    wake = TruckWake()
    cases = [(0.0, 0), *((f, k) for f in frequency for k in lead)]
    rows = [_force(wake, *case, controlled, settle) for case in track(cases, "sines", "runs")]
    table = Table(*rows[0])
    for row in rows:
        table.add_row(*(f"{value:.4g}" for value in row.values()))
    console.print(table)
    facts = {
        "amplitude": wake.config.action_limit,
        "controlled": controlled,
        "settle": settle,
        "versions": versions("stillwake", "numpy", "numba"),
    }
    save(json_file, figures=rows, facts=facts)


def _force(wake: TruckWake, frequency: float, lead: int, controlled: float, settle: float) -> dict[str, Any]:
    wake.reset(developed_state())
    for _ in range(lead):
        wake.advance(0.0)
    began = wake.t
    period, limit = wake.config.control_period, wake.config.action_limit
    samples: list[Sample] = []
    for k in range(round(controlled / period)):
        sample = wake.advance(limit * float(np.sin(2.0 * np.pi * frequency * k * period)))
        if sample.t > began + settle:
            samples.append(sample)

    def series(name: str) -> Array:
        return np.array([getattr(s, name) for s in samples])

    t = series("t")
    average = over_last_cycles(t, frequency) if frequency else over_cycles(t, series("Cl"))
    return {
        "frequency": frequency,
        "lead": lead,
        "Cd": float(average.mean(series("Cd"))),
        "base_Cp": float(average.mean(series("Cp")[:, sensors.BASE].mean(axis=1))),
        "abs_Cl": float(average.mean(np.abs(series("Cl")))),
        "mean_Cl": float(average.mean(series("Cl"))),
        "rms_action": float(np.sqrt(average.mean(series("action") ** 2))),
        "Cd_net": float(average.mean(series("Cd_net"))),
        "jet_power": float(average.mean(series("jet_power"))),
    }
