"""The study's figures that are drawn from its networks and its recording."""

from typing import Final

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.model.study.figures import FORCES, REFERENCE
from benchmarks.model.study.lab import Lab, scaling, test_rows, training_rows
from contract import sensors
from train.distillation.distil import encode_all
from train.model_store import load

STRETCHES: Final = ((3000, 3400), (9500, 9900))
"""Control steps of the chirp that are drawn."""


def drawn(lab: Lab) -> dict[str, Figure]:
    """Every one of them by its file's name."""
    return {"model_forces": forces(lab), "model_latents": latent_pairs(lab)}


def forces(lab: Lab) -> Figure:
    """Two stretches of the chirp: recorded forces, and what the release's networks make of 4 pressures."""
    trained = load(lab.variant("hardened"))
    rows = test_rows()
    latents = encode_all(trained.slim, rows.with_sensors(sensors.TRUCK.indices(trained.sensors)))
    with torch.no_grad():
        decoded = trained.deployed.decoder(latents)
    mean, std = np.array(scaling().force_mean), np.array(scaling().force_std)
    predicted, true = decoded.numpy() * std + mean, rows.forces.numpy() * std + mean
    t = lab.config.flow.control_period * np.arange(len(true))
    figure = Figure(figsize=(10.0, 4.6), dpi=100, layout="constrained")
    grid = figure.subplots(2, 2, sharey="row", sharex="col")
    for column, (start, stop) in enumerate(STRETCHES):
        for row, (_, label, colour) in enumerate(FORCES):
            axes: Axes = grid[row, column]
            axes.plot(t[start:stop], true[start:stop, row], color=REFERENCE, linewidth=1.2, label="recorded")
            axes.plot(t[start:stop], predicted[start:stop, row], "--", color=colour, linewidth=1.2, label="4 sensors")
            axes.grid(color="0.9")
            axes.margins(y=0.2)
            axes.set_ylabel(label if column == 0 else "")
        frequency = [_chirp_frequency(lab, k, len(true)) for k in (start, stop)]
        grid[0, column].set_title(f"forcing at {frequency[0]:.2f} to {frequency[1]:.2f} / $t_c$", fontsize=10)
        grid[1, column].set_xlabel("t / $t_c$")
    for axes in grid[:, 0]:
        axes.legend(fontsize=8, loc="upper left", ncols=2)
    return figure


def latent_pairs(lab: Lab) -> Figure:
    """Every pair of the teacher's latents on training data, upper ones by lift, lower ones by drag (paper, fig. 6)."""
    trained, rows = lab.model(), training_rows()
    latents = encode_all(trained.teacher.encoder, rows)
    seen = torch.nonzero(~latents[:, 0].isnan()).flatten()
    thin = seen[torch.randperm(len(seen), generator=torch.Generator().manual_seed(0))[:2500]]
    z, c = latents[thin].numpy(), rows.forces[thin].numpy()
    size = z.shape[1]
    figure = Figure(figsize=(11.0, 11.0), dpi=75, layout="constrained")
    grid = figure.subplots(size, size, sharex="col", squeeze=False)
    for i in range(size):
        for j in range(size):
            axes: Axes = grid[i, j]
            axes.tick_params(labelleft=False, left=False, labelsize=7)
            if i == j:
                axes.hist(z[:, i], bins=50, color="0.5")
            else:
                force = c[:, 1] if j > i else c[:, 0]
                axes.scatter(z[:, j], z[:, i], c=force, s=1, vmin=-2, vmax=2, cmap="RdBu_r" if j > i else "viridis")
        grid[i, 0].set_ylabel(f"$z_{i + 1}$")
        grid[-1, i].set_xlabel(f"$z_{i + 1}$")
    figure.suptitle("upper: by $C_l$ (blue to red), lower: by $C_d$ (dark to light)", fontsize=11)
    return figure


def _chirp_frequency(lab: Lab, step: int, steps: int) -> float:
    forcing = lab.config.forcing
    return forcing.chirp_start + (forcing.chirp_end - forcing.chirp_start) * step / steps
