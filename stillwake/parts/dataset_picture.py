"""A picture of a data set: the positions of its sensors, and the start of its first time series."""

from pathlib import Path
from typing import Final

import matplotlib.pyplot as plt
import numpy as np

from contract.atomic import replacing
from contract.errors import ConfigError
from contract.recording.dataset import Dataset

_STEPS: Final = 200
"""Number of control steps that are drawn, which cover eight shedding cycles of the truck."""


def draw(dataset: Dataset, path: Path) -> None:
    """Write a picture as PNG, completely or not at all. Raises StillwakeError if the file's name does not end in .png,
    or the file cannot be written."""
    if path.suffix.lower() != ".png":
        raise ConfigError(f"{path}: a picture must end in .png")
    layout, first = dataset.layout, dataset.episodes[0]
    figure, axes = plt.subplots(4, 1, figsize=(8, 9), height_ratios=(2, 1, 1, 1), layout="constrained")
    places = axes[0]
    x, y = layout.positions.T
    on_base = np.isin(np.arange(len(layout)), layout.base)
    places.plot(x[~on_base], y[~on_base], "o", label="sensor")
    if on_base.any():
        places.plot(x[on_base], y[on_base], "s", label="on the base")
    if len(layout) <= 40:
        for name, at in zip(layout.names, layout.positions, strict=True):
            places.annotate(name, (at[0], at[1]), xytext=(3, 3), textcoords="offset points", fontsize=7)
    places.set(xlabel="x / W", ylabel="y / W", aspect="equal", title=f"{len(layout)} sensors")
    places.legend(loc="upper left", bbox_to_anchor=(1.02, 1.0))
    shown = slice(0, _STEPS)
    t = first.series["t"][shown]
    for axis, name in zip(axes[1:], ("action", "Cd", "Cl"), strict=True):
        axis.plot(t, first.series[name][shown])
        axis.set_ylabel(name)
    axes[1].set_title(f"episode {first.name}")
    axes[-1].set_xlabel("t / t_c")
    try:
        with replacing(path) as temporary:
            figure.savefig(temporary, format="png", dpi=120)
    finally:
        plt.close(figure)
