"""The recording format: HDF5, one group an episode (docs/architecture.md, "Dataset").

Sample k holds Cp, the forces at t_k and the action a_k commanded at t_k; the jet ramps linearly from a_{k-1}
to a_k over [t_k, t_{k+1}]. Cd and Cl are the wall's: pressure and viscous force without the slot faces.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, get_args

import h5py
import numpy as np
import numpy.typing as npt

from contract import sensors
from contract.atomic import replacing
from contract.errors import DatasetError

SCHEMA: Final = "stillwake-dataset/1"
Role = Literal["train", "test"]

UNITS: Final[Mapping[str, str]] = {
    "t": "W/U_inf",
    "action": "U_inf W",
    "Cp": "1",
    "Cd": "1",
    "Cl": "1",
    "Cd_slot": "1",
    "Cd_momentum": "1",
    "jet_power": "rho U_inf^3 W / 2",
    "Uy_probe": "U_inf",
}
"""Arrays of an episode and their units; all have one row a control step, Cp has 90 columns."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Episode:
    """One uninterrupted recording of n control steps.

    Attributes:
        name: unique within the dataset.
        role: whether the model may be fitted to it.
        series: the arrays of `UNITS`; Cp is (n, 90), the others (n,).
        initial_action: a_{-1}, the action in force before the first sample.
        provenance: forcing parameters, seed, solver settings, software versions.
    """

    name: str
    role: Role
    series: Mapping[str, npt.NDArray[np.float64]]
    initial_action: float
    provenance: Mapping[str, Any]

    def __post_init__(self) -> None:
        _check(self)

    def __len__(self) -> int:
        return len(self.series["t"])

    @property
    def previous_action(self) -> npt.NDArray[np.float64]:
        """a_{k-1} for every k, shape (n,): what the encoder sees beside Cp_k."""
        return np.concatenate([[self.initial_action], self.series["action"][:-1]])


@dataclass(frozen=True, kw_only=True, eq=False)
class Dataset:
    """Episodes in recorded order."""

    episodes: tuple[Episode, ...]

    def __post_init__(self) -> None:
        names = [episode.name for episode in self.episodes]
        for name in names:
            if names.count(name) > 1:
                raise DatasetError(f"episode {name}: named twice")

    def with_role(self, role: Role) -> tuple[Episode, ...]:
        """The episodes of that role; raises DatasetError if there is none."""
        found = tuple(episode for episode in self.episodes if episode.role == role)
        if not found:
            raise DatasetError(f"dataset has no episode with role {role!r}")
        return found


def read(path: Path) -> Dataset:
    """Read and check a dataset.

    Raises:
        DatasetError: if the file is missing, truncated, of another schema, or a field does not fit; the
            message names the episode and the field.
    """
    if not path.is_file():
        raise DatasetError(f"{path}: no such dataset")
    try:
        with h5py.File(path, "r") as file:
            schema = file.attrs.get("schema")
            if schema != SCHEMA:
                raise DatasetError(f"{path}: schema {schema!r}, this version reads {SCHEMA!r}")
            if json.loads(file.attrs["sensors"]) != list(sensors.NAMES):
                raise DatasetError(f"{path}: recorded with other sensors, or in another order")
            episodes = tuple(_read_episode(name, file["episodes"][name]) for name in file["episodes"])
    except (OSError, KeyError, ValueError, TypeError, AttributeError, RuntimeError) as error:
        raise DatasetError(f"{path}: damaged or not an HDF5 dataset ({error})") from error
    if not episodes:
        raise DatasetError(f"{path}: holds no episode")
    return Dataset(episodes=episodes)


def write(path: Path, dataset: Dataset) -> None:
    """Write a dataset, whole or not at all. Values are stored in single precision."""
    with replacing(path) as temporary, h5py.File(temporary, "w", track_order=True) as file:
        file.attrs["schema"] = SCHEMA
        file.attrs["sensors"] = json.dumps(sensors.NAMES)
        group = file.create_group("episodes", track_order=True)
        for episode in dataset.episodes:
            node = group.create_group(episode.name)
            node.attrs["role"] = episode.role
            node.attrs["initial_action"] = episode.initial_action
            node.attrs["provenance"] = json.dumps(episode.provenance, sort_keys=True)
            for name, unit in UNITS.items():
                # Time stays double: k * 0.2 in single precision would no longer be evenly spaced.
                dtype = np.float64 if name == "t" else np.float32
                array = node.create_dataset(
                    name, data=episode.series[name].astype(dtype), compression="gzip", compression_opts=9, shuffle=True
                )
                array.attrs["units"] = unit


def _read_episode(name: str, node: h5py.Group) -> Episode:
    missing = [field for field in UNITS if field not in node]
    if missing:
        raise DatasetError(f"episode {name}: field {missing[0]!r} is missing")
    for field, unit in UNITS.items():
        found = node[field].attrs.get("units")
        if found != unit:
            raise DatasetError(f"episode {name}: field {field!r} is in {found!r}, must be in {unit!r}")
    return Episode(
        name=name,
        role=node.attrs["role"],
        series={field: np.asarray(node[field], dtype=np.float64) for field in UNITS},
        initial_action=float(node.attrs["initial_action"]),
        provenance=json.loads(node.attrs["provenance"]),
    )


def _check(episode: Episode) -> None:
    def refuse(field: str, reason: str) -> None:
        raise DatasetError(f"episode {episode.name}: field {field!r} {reason}")

    if not episode.name or "/" in episode.name:
        refuse("name", "must not be empty or hold a slash")
    if episode.role not in get_args(Role):
        refuse("role", f"is {episode.role!r}, must be one of {get_args(Role)}")
    for field in UNITS:
        if field not in episode.series:
            refuse(field, "is missing")
    steps = episode.series["t"].size
    if steps == 0:
        refuse("t", "holds no control step")
    for field in UNITS:
        array = episode.series[field]
        expected = (steps, sensors.COUNT) if field == "Cp" else (steps,)
        if array.shape != expected:
            refuse(field, f"has shape {array.shape}, must be {expected}")
        if not np.isfinite(array).all():
            refuse(
                field, f"holds a value that is not finite, first at step {int(np.argwhere(~np.isfinite(array))[0][0])}"
            )
    if not np.isfinite(episode.initial_action):
        refuse("initial_action", "is not finite")
