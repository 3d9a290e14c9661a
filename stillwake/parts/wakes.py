"""The steady wake, computed with a display of its progress, and the settings for a drive at varying speeds."""

from dataclasses import replace
from math import log10
from pathlib import Path
from typing import TYPE_CHECKING

from contract.config.tree import Config
from stillwake.console.progress import progress

if TYPE_CHECKING:
    from wake.plant.drive import Drive


def settle_into(output: Path, config: Config) -> tuple[dict[str, float], tuple[int, int]]:
    """Compute the steady wake with these settings and write its state. Return figures of the wake, and the numbers of
    cells of its grid. Raises PlantError if the flow does not settle; StillwakeError if the file cannot be written."""
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


def driven_at(name: str | None, config: Config, *, after_s: float = 0.0) -> "tuple[Drive | None, Config]":
    """Return a drive by its name or file, delayed by `after_s` seconds, and the settings with the solver steps that the
    drive needs. Without a name, return None and the unchanged settings. Raises ConfigError for an unknown drive."""
    if name is None:
        return None, config
    from wake.plant.drive import find_drive

    drive = find_drive(name, config.operating_point)
    drive = drive.after(after_s) if after_s else drive
    return drive, replace(config, flow=drive.substeps(config.flow, config.operating_point))
