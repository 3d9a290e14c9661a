"""The recording format: HDF5, one group an episode (docs/reference/data-set.md).

Sample k holds Cp, the forces at t_k and the action a_k commanded at t_k; the jet ramps linearly from a_{k-1}
to a_k over [t_k, t_{k+1}]. Cd and Cl are the wall's: pressure and viscous force without the slot faces.
"""

import io
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, get_args

import h5py
import numpy as np
import numpy.typing as npt

from contract import sensors
from contract.arrays import Array
from contract.atomic import replacing
from contract.errors import DatasetError
from contract.ledger import DragLedger, ledger_of
from contract.recording.int16_series import pack, unpack

SCHEMA: Final = "stillwake-dataset/2"
SCHEMA_1: Final = "stillwake-dataset/1"
"""Still read: float32 series, and one `Cd_slot` where pressure and viscous force now stand apart."""
Role = Literal["train", "test", "extended", "controlled"]
"""The model is fitted to "train" and judged on "test"; "extended" asks for more than it was trained for; "controlled"
is held out like them, and recorded while a controller drove the jets."""

UNITS: Final[Mapping[str, str]] = {
    "t": "W/U_inf",
    "action": "U_inf W",
    "Cp": "1",
    "Cd": "1",
    "Cl": "1",
    "Cd_slot_pressure": "1",
    "Cd_slot_viscous": "1",
    "Cd_momentum": "1",
    "jet_power": "rho U_inf^3 W / 2",
    "Uy_probe": "U_inf",
}
"""Arrays of an episode and their units; all have one row a control step, Cp has 90 columns."""

EXACT: Final = frozenset({"t", "action"})
"""Stored in double precision: they are set, not measured."""
QUANTUM: Final = 2.0**-15
CP_QUANTUM: Final = 2.0**-13
"""Finest quantum of a measured series: 16 bits over +-1, for Cp over +-4. The bus carries 2.7e-4 of Cp (0.1 Pa at the
default operating point). A series that reaches further takes the next power of two that holds it."""
COARSEST_QUANTUM: Final = 2.0**-8
"""A series beyond +-128 is refused: no coefficient of this flow comes near that."""
_CHUNK: Final = 1000
"""Control steps compressed together."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Episode:
    """One uninterrupted recording of n control steps.

    Attributes:
        name: unique within the dataset.
        role: what the model may use it for.
        series: the arrays of `UNITS`; Cp is (n, 90), the others (n,).
        initial_action: a_{-1}, the action in force before the first sample.
        provenance: forcing parameters, seed, solver settings, software versions.
    """

    name: str
    role: Role
    series: Mapping[str, Array]
    initial_action: float
    provenance: Mapping[str, Any]

    def __post_init__(self) -> None:
        _check(self)

    def __len__(self) -> int:
        return len(self.series["t"])

    @property
    def previous_action(self) -> Array:
        """a_{k-1} for every k, shape (n,): the encoder's input next to Cp_k."""
        return np.concatenate([[self.initial_action], self.series["action"][:-1]])

    @property
    def ledger(self) -> DragLedger[Array]:
        """The drag ledger, every entry of shape (n,)."""
        return ledger_of(self.series)


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
            if schema not in (SCHEMA, SCHEMA_1):
                raise DatasetError(f"{path}: schema {schema!r}, this version reads {SCHEMA!r}")
            if json.loads(file.attrs["sensors"]) != list(sensors.NAMES):
                raise DatasetError(f"{path}: recorded with other sensors, or in another order")
            reader = _read_episode if schema == SCHEMA else _read_episode_1
            episodes = tuple(reader(name, file["episodes"][name]) for name in file["episodes"])
    except (OSError, KeyError, ValueError, TypeError, AttributeError, RuntimeError) as error:
        raise DatasetError(f"{path}: damaged or not an HDF5 dataset ({error})") from error
    if not episodes:
        raise DatasetError(f"{path}: holds no episode")
    return Dataset(episodes=episodes)


def write(path: Path, dataset: Dataset) -> None:
    """Write a dataset, whole or not at all.

    `t` and `action` are stored in double precision, what was measured as 16-bit integers: each value within half of
    the quantum that stands beside its series.

    Raises:
        DatasetError: if a series exceeds what 16 bits can hold; the message names episode and field.
        StillwakeError: if the file cannot be written.
    """
    # In memory first: HDF5 gives no clear error when a disk is full.
    image = io.BytesIO()
    with h5py.File(image, "w", track_order=True) as file:
        file.attrs["schema"] = SCHEMA
        file.attrs["sensors"] = json.dumps(sensors.NAMES)
        group = file.create_group("episodes", track_order=True)
        for episode in dataset.episodes:
            _write_episode(group.create_group(episode.name), episode)
    with replacing(path) as temporary:
        temporary.write_bytes(image.getbuffer())


def _write_episode(node: h5py.Group, episode: Episode) -> None:
    node.attrs["role"] = episode.role
    node.attrs["initial_action"] = episode.initial_action
    node.attrs["provenance"] = json.dumps(episode.provenance, sort_keys=True)
    for name, unit in UNITS.items():
        values: npt.NDArray[Any] = episode.series[name]
        attributes: dict[str, Any] = {"units": unit}
        if name not in EXACT:
            finest = CP_QUANTUM if name == "Cp" else QUANTUM
            try:
                values, attributes["quantum"] = pack(values, finest, COARSEST_QUANTUM)
            except ValueError as error:
                raise DatasetError(f"episode {episode.name}: field {name!r} {error}") from error
        chunk = (min(_CHUNK, len(values)), *values.shape[1:])
        array = node.create_dataset(
            name, data=values, chunks=chunk, compression="gzip", compression_opts=9, shuffle=True
        )
        array.attrs.update(attributes)


def _read_episode(name: str, node: h5py.Group) -> Episode:
    return _episode(name, node, {field: _read_series(name, node, field, unit) for field, unit in UNITS.items()})


def _read_episode_1(name: str, node: h5py.Group) -> Episode:
    fields = {"Cd_slot" if field == "Cd_slot_pressure" else field: unit for field, unit in UNITS.items()}
    del fields["Cd_slot_viscous"]
    series = {field: _read_series(name, node, field, unit) for field, unit in fields.items()}
    # The one recorded force stands under pressure, which is nearly all of it; the sum is as recorded.
    series["Cd_slot_pressure"] = series.pop("Cd_slot")
    series["Cd_slot_viscous"] = np.zeros_like(series["Cd_slot_pressure"])
    return _episode(name, node, series)


def _episode(name: str, node: h5py.Group, series: dict[str, Array]) -> Episode:
    return Episode(
        name=name,
        role=node.attrs["role"],
        series=series,
        initial_action=float(node.attrs["initial_action"]),
        provenance=json.loads(node.attrs["provenance"]),
    )


def _read_series(name: str, node: h5py.Group, field: str, unit: str) -> Array:
    """Floating-point numbers as they are, integers times their quantum."""
    if field not in node:
        raise DatasetError(f"episode {name}: field {field!r} is missing")
    stored = node[field]
    found = stored.attrs.get("units")
    if found != unit:
        raise DatasetError(f"episode {name}: field {field!r} is in {found!r}, must be in {unit!r}")
    if stored.dtype.kind == "f":
        return np.asarray(stored, dtype=np.float64)
    quantum = stored.attrs.get("quantum", np.nan)
    if stored.dtype != np.int16 or not (np.isfinite(quantum) and quantum > 0):
        raise DatasetError(
            f"episode {name}: field {field!r} is stored as {stored.dtype} with quantum {quantum}: must be "
            f"floating-point, or int16 with a positive quantum"
        )
    return unpack(np.asarray(stored), float(quantum))


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
