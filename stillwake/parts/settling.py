"""The computation of the steady wake, with a display of its progress."""

from math import log10
from pathlib import Path

from contract.config.tree import Config
from stillwake.console.progress import progress


def settle_into(output: Path, config: Config) -> tuple[dict[str, float], tuple[int, int]]:
    """Compute the steady wake with these settings and write its state. Return its figures and its grid's numbers of
    cells. Raises PlantError if the flow does not settle; StillwakeError if the file cannot be written."""
    from wake.truck import develop, truck_wake
    from wake.truck.state import save_state

    wake = truck_wake.TruckWake(config.flow, body=config.body)
    # The rates of change fall exponentially, so the progress is the number of decades by which they have fallen.
    decades = -log10(develop.TOLERANCE)
    with progress("decades") as report:

        def show(t: float, rate: float) -> None:
            done = min(decades, max(0.0, -log10(rate)))
            report("settling", round(done, 2), decades, f"t {t:.0f}  max |d/dt| {rate:.1e}")

        state, figures = develop.settle(wake, progress=show)
    save_state(output, state)
    return figures, wake.grid.shape
