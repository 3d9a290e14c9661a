"""Choose sensors by orthogonal matching pursuit of the forces (docs/how-to/add-a-sensor-selection.md)."""

import sys
from pathlib import Path

import numpy as np
import typer

from contract.errors import StillwakeError
from contract.recording.dataset import read
from train.networks.samples import Rows, fit_scaling, prepare


def select_by_forces(rows: Rows, count: int) -> tuple[int, ...]:
    """Return the columns of `count` sensors in the order of their choice. Each new sensor correlates best with the part
    of the forces that the earlier sensors do not explain."""
    pressure = rows.inputs[:, : rows.sensors].cpu().numpy().astype(np.float64)  # (n, N)
    forces = rows.forces.cpu().numpy().astype(np.float64)  # (n, 2): Cd, Cl
    left = forces
    chosen: list[int] = []
    for _ in range(count):
        score = np.abs(pressure.T @ left).sum(axis=1) / np.linalg.norm(pressure, axis=0)
        score[chosen] = -np.inf
        chosen.append(int(score.argmax()))
        weights, *_ = np.linalg.lstsq(pressure[:, chosen], forces, rcond=None)
        left = forces - pressure[:, chosen] @ weights
    return tuple(chosen)


def main(path: str, count: int) -> None:
    try:
        dataset = read(Path(path))
        episodes = dataset.with_role("train")
        scaling = fit_scaling(episodes, dataset.layout)
    except StillwakeError as error:
        sys.exit(f"error: {error}")
    most = len(dataset.layout.names)
    if not 1 <= count <= most:
        raise typer.BadParameter(f"COUNT = {count}: must be from 1 to {most}, the number of sensors")
    rows = prepare(episodes, scaling, mirrored=dataset.layout.mirror is not None, layout=dataset.layout)
    names = (dataset.layout.names[column] for column in select_by_forces(rows, count))
    sys.stdout.write(",".join(names) + "\n")


if __name__ == "__main__":
    typer.run(main)
