"""Write a recording of the project's solver as plain CSV files with a table of sensors, as another solver might do.

    python examples/square_cylinder/as_csv.py square.h5 csv

The command writes `csv/sensors.csv` (name, x, y, base), and for each episode a file `csv/ROLE_NAME.csv` with the
columns t, action, Cd, Cl and one column per sensor.
"""

import csv
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from rich import print

from contract.recording.dataset import Episode, read
from contract.sensor_layout import SensorLayout


def write_sensors(path: Path, layout: SensorLayout) -> None:
    """Write one line per sensor; `base` is 1 on the base and 0 elsewhere."""
    base = set(layout.base.tolist())
    places = zip(layout.names, layout.positions.tolist(), strict=True)
    _write(path, ("name", "x", "y", "base"), ((name, *at, int(k in base)) for k, (name, at) in enumerate(places)))


def write_episode(path: Path, episode: Episode, layout: SensorLayout) -> None:
    """Write one line per control step."""
    series = [episode.series[name] for name in ("t", "action", "Cd", "Cl")]
    _write(path, ("t", "action", "Cd", "Cl", *layout.names), np.column_stack([*series, episode.series["Cp"]]).tolist())


def _write(path: Path, heads: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(heads)
        writer.writerows(rows)


def main(recording: Path, folder: Path) -> None:
    """Write the files of one recording."""
    dataset = read(recording)
    folder.mkdir(parents=True, exist_ok=True)
    write_sensors(folder / "sensors.csv", dataset.layout)
    for episode in dataset.episodes:
        path = folder / f"{episode.role}_{episode.name}.csv"
        write_episode(path, episode, dataset.layout)
        print(f"wrote {path}: {len(episode)} control steps")


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit("usage: as_csv.py RECORDING.h5 FOLDER")
    main(Path(sys.argv[1]), Path(sys.argv[2]))
