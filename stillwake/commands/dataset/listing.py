"""The contents of a data set, for the terminal."""

from typing import TYPE_CHECKING

from rich.box import SIMPLE
from rich.table import Table

if TYPE_CHECKING:
    from contract.recording.dataset import Dataset
    from contract.sensor_layout import SensorLayout


def episodes_table(found: "Dataset") -> Table:
    """Return a table with one row per episode."""
    from contract.recording.summary import summarise

    table = Table(box=SIMPLE, padding=0)
    table.add_column("episode", overflow="fold", min_width=min(20, max(len(item.name) for item in found.episodes)))
    for name in ("role", "steps", "t / t_c", "rms action", "mean Cd", "std Cl", "Cl peak, 1/t_c"):
        table.add_column(name, justify="left" if name == "role" else "right")
    for item in summarise(found):
        table.add_row(
            item.name,
            item.role,
            str(item.steps),
            f"{item.duration:.1f}",
            f"{item.action_rms:.4f}",
            f"{item.drag:.4f}",
            f"{item.lift:.4f}",
            "" if item.frequency is None else f"{item.frequency:.3f}",
        )
    return table


def sensors_line(layout: "SensorLayout") -> str:
    """Return the number of sensors and their names."""
    names = layout.names if len(layout) <= 12 else (*layout.names[:6], "..", *layout.names[-3:])
    images = "with" if layout.mirror is not None else "without"
    return f"{len(layout)} sensors, {len(layout.base)} on the base, {images} mirror images: {', '.join(names)}"
