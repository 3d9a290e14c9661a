"""The recording format: an HDF5 file with one group per episode and the sensors' layout (docs/reference/data-set.md).

Measured series are stored as 16-bit integers, value = integer * quantum, like the output of a 16-bit sensor. The
quantum is a power of two, so that reading is exact, and writing unchanged data again gives the same integers.
"""

import io
import json
from collections import ChainMap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np
import numpy.typing as npt

from contract.arrays import Array
from contract.atomic import replacing
from contract.errors import ConfigError, DatasetError
from contract.recording.episode import FACTS, REQUIRED, ROLES, PlantFacts, facts_in, problems_of
from contract.recording.episode import UNITS as UNITS
from contract.recording.episode import Episode as Episode
from contract.recording.episode import Role as Role
from contract.recording.hdf5 import opened
from contract.sensor_layout import SensorLayout
from contract.sensors import TRUCK
from contract.typed import differences

DATASET_SCHEMA: Final = "stillwake-dataset/3"
DATASET_SCHEMA_2: Final = "stillwake-dataset/2"
"""Older schema, which is still read. It has the truck's sensors, ten series, and plant facts in the provenance."""
QUANTUM: Final = 2.0**-15
CP_QUANTUM: Final = 2.0**-13
"""Smallest quantum of Cp; that of other measured series is `QUANTUM`. 16 bits then hold Cp within +-4, and the other
series within +-1. The bus transmits Cp in steps of 2.7e-4 (0.1 Pa at the default operating point)."""
COARSEST_QUANTUM: Final = 2.0**-8
"""Largest quantum. So values beyond +-128 are refused; no coefficient of this flow comes near 128."""
_ATTRIBUTES: Final = {
    "role": f"one of {', '.join(ROLES)}",
    "initial_action": "the action in force before the first sample",
    "provenance": "a JSON object, {} if nothing is known",
}
LARGEST_INTEGER: Final = 32767
"""Largest stored integer. The smallest is its negative, so that the mirror image of a series can also be stored."""


def pack(values: Array, finest: float, coarsest: float) -> tuple[npt.NDArray[np.int16], float]:
    """Convert finite values of any shape to integers and their quantum. The quantum is `finest` times the smallest
    power of two with which every value fits into 16 bits. Raises ValueError for values beyond +-32767 * coarsest."""
    quantum, peak = finest, float(np.abs(values).max(initial=0.0))
    while np.rint(peak / quantum) > LARGEST_INTEGER:
        quantum *= 2.0
        if quantum > coarsest:
            raise ValueError(f"holds {peak:g}, more than {LARGEST_INTEGER * coarsest:g} in magnitude")
    return np.rint(values / quantum).astype(np.int16), quantum


def unpack(integers: npt.NDArray[np.int16], quantum: float) -> Array:
    """Convert integers back to values. A value differs from the value before packing by at most half a quantum."""
    return integers.astype(np.float64) * quantum


@dataclass(frozen=True, kw_only=True, eq=False)
class Dataset:
    """The episodes of a data set in recorded order, and the `facts` about the plant that the file states (see `plant`).
    Every Cp has one column for each sensor of the layout. Raises DatasetError for equal names or another shape."""

    episodes: tuple[Episode, ...]
    layout: SensorLayout = TRUCK
    facts: PlantFacts | None = None

    def __post_init__(self) -> None:
        names = [episode.name for episode in self.episodes]
        for episode in self.episodes:
            if names.count(episode.name) > 1:
                raise DatasetError(f"episode {episode.name}: two episodes have this name")
            if problem := _column_problem(episode, self.layout):
                raise DatasetError(problem)

    def with_role(self, role: Role) -> tuple[Episode, ...]:
        """Return the episodes with this role. Raises DatasetError if there are none."""
        found = tuple(episode for episode in self.episodes if episode.role == role)
        if not found:
            raise DatasetError(f"dataset has no episode with role {role!r}")
        return found

    @property
    def plant(self) -> PlantFacts:
        """The plant's facts: those of `facts`, then of the episodes' provenance, then the period from the times t."""
        given = () if self.facts is None else (self.facts,)
        facts = (*given, *(facts_in(item.provenance) for item in self.episodes), _clock(self.episodes))
        return PlantFacts(**ChainMap(*(one.known for one in facts)))


def read(path: Path) -> Dataset:
    """Read and check a data set. Raises DatasetError with file, episode and field for the first problem."""
    dataset, problems = survey(path)
    if dataset is None or problems:
        first = problems[0]
        raise DatasetError(first if str(path) in first else f"{path}: {first}")
    return dataset


def survey(path: Path) -> tuple[Dataset | None, tuple[str, ...]]:
    """Return a data set of the valid episodes (None if no episode is valid), and all problems, one line each."""
    problems: list[str] = []
    dataset = None
    try:
        dataset = _surveyed(path, problems)
    except DatasetError as error:
        problems.append(str(error))
    except (OSError, KeyError, ValueError, TypeError, AttributeError, RuntimeError) as error:
        problems.append(f"{path}: is damaged or not an HDF5 dataset ({error})")
    return dataset, tuple(problems)


def write(path: Path, dataset: Dataset) -> None:
    """Write a data set, completely or not at all. A stored value differs from the original value by at most half the
    quantum of its series; `t` and `action` are exact. Raises DatasetError with episode and field if a series exceeds
    the range of 16 bits, and StillwakeError if the file cannot be written."""
    # The file is built in memory first, because HDF5 gives no clear error when a disk is full.
    image = io.BytesIO()
    with h5py.File(image, "w", track_order=True) as file:
        file.attrs["schema"] = DATASET_SCHEMA
        file.attrs.update(dataset.plant.known)
        layout, mirror = file.create_group("layout", track_order=True), dataset.layout.mirror
        layout.create_dataset("names", data=list(dataset.layout.names), dtype=h5py.string_dtype())
        layout.create_dataset("positions", data=dataset.layout.positions).attrs["units"] = "W"
        layout.create_dataset("base", data=dataset.layout.base.astype(np.int64))
        if mirror is not None:
            layout.create_dataset("mirror", data=mirror.astype(np.int64))
        group = file.create_group("episodes", track_order=True)
        for episode in dataset.episodes:
            _write_episode(group.create_group(episode.name), episode)
    with replacing(path) as temporary:
        temporary.write_bytes(image.getbuffer())


def read_to_append(path: Path, facts: Mapping[str, Any], layout: SensorLayout = TRUCK) -> Dataset:
    """Return an existing data set, or a data set without episodes if there is no file. `facts` is the provenance that
    old and new episodes must share, such as the flow's settings. Raises DatasetError if the file is not a data set, or
    if its sensors or the facts of an episode differ from `layout` and `facts`; the message states a difference."""
    if not path.exists():
        return Dataset(episodes=(), layout=layout)
    there = read(path)
    difference = there.layout.difference(layout)
    if difference is not None:
        raise DatasetError(f"{path}: its sensors differ from those of the new episodes, in {difference}")
    for episode in there.episodes:
        found = {name: episode.provenance[name] for name in facts if name in episode.provenance}
        for name, there, here in differences(found, facts):
            raise DatasetError(
                f"{path}: episode {episode.name} was recorded with {name} = {there}; the new episodes have {here}: "
                f"name another file"
            )
    return there


def append(path: Path, episodes: Sequence[Episode], facts: Mapping[str, Any], layout: SensorLayout = TRUCK) -> None:
    """Add episodes at the end of a data set; create the data set if there is no file. The values of old episodes do not
    change. Raises the errors of `read_to_append` and `write`, and DatasetError if a name is already used."""
    there = read_to_append(path, facts, layout)
    write(path, replace(there, episodes=(*there.episodes, *episodes)))


def _surveyed(path: Path, problems: list[str]) -> Dataset | None:
    with opened(path) as file:
        schema = file.attrs.get("schema")
        if schema not in (DATASET_SCHEMA, DATASET_SCHEMA_2):
            raise DatasetError(f"{path}: has schema {schema!r}; this version reads {DATASET_SCHEMA!r}")
        layout, facts = TRUCK, None
        if schema == DATASET_SCHEMA:
            layout, facts = _read_layout(path, file), _read_facts(path, file)
        elif json.loads(file.attrs["sensors"]) != list(TRUCK.names):
            raise DatasetError(f"{path}: its sensors or their order differ from the truck's")
        found = [_read_episode(name, file["episodes"][name], schema, problems) for name in file["episodes"]]
    if not found:
        raise DatasetError(f"{path}: holds no episode")
    unfit = {episode: _column_problem(episode, layout) for episode in found if episode is not None}
    problems += filter(None, unfit.values())
    sound = [episode for episode, problem in unfit.items() if problem is None]
    return Dataset(episodes=tuple(sound), layout=layout, facts=facts) if sound else None


def _column_problem(episode: Episode, layout: SensorLayout) -> str | None:
    shape, expected = episode.series["Cp"].shape, (len(episode), len(layout))
    return None if shape == expected else f"episode {episode.name}: field 'Cp' has shape {shape}, must be {expected}"


def _clock(episodes: tuple[Episode, ...]) -> PlantFacts:
    """Return the control period as a fact: the mean time step of the first episode with at least two times."""
    for episode in episodes:
        t = episode.series["t"]
        if len(t) > 1 and t[-1] > t[0]:
            # Rounding removes the floating-point error, so that a period of 0.2 is exactly 0.2.
            return PlantFacts(control_period=float(f"{(t[-1] - t[0]) / (len(t) - 1):.9g}"))
    return PlantFacts()


def _read_layout(path: Path, file: h5py.File) -> SensorLayout:
    for name in ("layout", "layout/names", "layout/positions", "layout/base"):
        if name not in file:
            raise DatasetError(f"{path}: {name!r} is missing: the file must have the sensors' layout")
    node = file["layout"]
    try:
        return SensorLayout(
            names=tuple(node["names"].asstr()[:].tolist()),
            positions=np.asarray(node["positions"], dtype=np.float64),
            base=np.asarray(node["base"], dtype=np.intp),
            mirror=np.asarray(node["mirror"], dtype=np.intp) if "mirror" in node else None,
        )
    except (ConfigError, TypeError, ValueError, IndexError) as error:
        raise DatasetError(f"{path}: layout: {error}") from error


def _read_facts(path: Path, file: h5py.File) -> PlantFacts:
    try:
        return PlantFacts(**{name: float(file.attrs[name]) for name in FACTS if name in file.attrs})
    except (DatasetError, TypeError, ValueError) as error:
        raise DatasetError(f"{path}: {error}") from error


def _write_episode(node: h5py.Group, episode: Episode) -> None:
    node.attrs["role"] = episode.role
    node.attrs["initial_action"] = episode.initial_action
    node.attrs["provenance"] = json.dumps(episode.provenance, sort_keys=True)
    for name, unit in UNITS.items():
        if name not in episode.series:
            continue
        values, quantum = packed(episode, name)
        attributes = {"units": unit} | ({} if quantum is None else {"quantum": quantum})
        chunk = (min(1000, len(values)), *values.shape[1:])
        storage = {"chunks": chunk, "compression": "gzip", "compression_opts": 9, "shuffle": True}
        node.create_dataset(name, data=values, **storage).attrs.update(attributes)


def packed(episode: Episode, name: str) -> tuple[npt.NDArray[Any], float | None]:
    """Return a series as stored: integers and quantum, or the values and None. Raises DatasetError beyond 16 bits."""
    values = episode.series[name]
    if name in ("t", "action"):  # times and commands are not measured values
        return values, None
    try:
        return pack(values, CP_QUANTUM if name == "Cp" else QUANTUM, COARSEST_QUANTUM)
    except ValueError as error:
        raise DatasetError(f"episode {episode.name}: field {name!r} {error}") from error


def _read_episode(name: str, node: h5py.Group | h5py.Dataset, schema: str, problems: list[str]) -> Episode | None:
    """Read an episode. If it has problems, append them to the list and return None."""
    found: list[str] = []
    fields = node if isinstance(node, h5py.Group) else {}
    series: dict[str, Array] = {}
    for field in UNITS:
        if field in fields:
            array = _read_series(name, field, fields[field], found)
            if array is not None:
                series[field] = array
        elif field in REQUIRED or schema != DATASET_SCHEMA:
            found.append(f"episode {name}: field {field!r} is missing")
    for key, meaning in _ATTRIBUTES.items():
        if key not in node.attrs:
            found.append(f"episode {name}: attribute {key!r} is missing: {meaning}")
    initial_action, provenance = 0.0, {}
    try:
        initial_action = float(node.attrs.get("initial_action", 0.0))
    except (TypeError, ValueError):
        found.append(f"episode {name}: attribute 'initial_action' is not a number")
    try:
        provenance = json.loads(node.attrs.get("provenance", "{}"))
    except (TypeError, ValueError):
        found.append(f"episode {name}: attribute 'provenance' is not JSON")
    if not isinstance(provenance, dict):
        found.append(f"episode {name}: attribute 'provenance' is not a JSON object")
    # A series that could not be read is already in the list, so the series is not also reported as missing.
    found += [
        line
        for line in problems_of(name, node.attrs.get("role", "train"), series, initial_action)
        if not line.endswith(" is missing")
    ]
    problems += found
    if found:
        return None
    facts: dict[str, Any] = {"initial_action": initial_action, "provenance": provenance}
    return Episode(name=name, role=node.attrs["role"], series=series, **facts)


def _read_series(name: str, field: str, stored: h5py.Dataset, problems: list[str]) -> Array | None:
    """Read a series; multiply integers by their quantum. If the series is invalid, append a problem and return None."""
    unit, found = UNITS[field], stored.attrs.get("units")
    if found != unit:
        what = "has no attribute 'units'" if found is None else f"is in {found!r}"
        problems.append(f"episode {name}: field {field!r} {what}, must be in {unit!r}")
        return None
    if stored.dtype.kind == "f":
        return np.asarray(stored, dtype=np.float64)
    quantum = stored.attrs.get("quantum", np.nan)
    if stored.dtype != np.int16 or not (np.isfinite(quantum) and quantum > 0):
        problems.append(
            f"episode {name}: field {field!r} is stored as {stored.dtype} with quantum {quantum}: must be "
            f"floating-point, or int16 with a positive quantum"
        )
        return None
    return unpack(np.asarray(stored), float(quantum))
