"""The steady wake with a progress bar, for the commands that need it."""

from math import log10
from pathlib import Path

from contract.config.tree import Config
from stillwake.console.terminal import progress_bar
from wake.truck import steady, truck_wake
from wake.truck.state import save_state


def settle_into(output: Path, config: Config) -> tuple[steady.SteadyWake, tuple[int, int]]:
    """Compute the steady wake of these settings and write its state. Raises PlantError if the flow does not settle;
    StillwakeError if the file cannot be written. Returns the steady wake, and the cells of its grid."""
    wake = truck_wake.TruckWake(config.flow, body=config.body)
    # Rates fall by decades.
    decades = -log10(steady.TOLERANCE)
    with progress_bar("decades") as bar:
        task = bar.add_task("settling", total=decades, note="")

        def progress(t: float, rate: float) -> None:
            done = min(decades, max(0.0, -log10(rate)))
            bar.update(task, completed=round(done, 2), note=f"t {t:.0f}  max |d/dt| {rate:.1e}")

        settled = steady.settle(wake, progress=progress)
    save_state(output, settled.state)
    return settled, wake.grid.shape
