"""Functions that add episodes to an existing data set."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from contract.errors import DatasetError
from contract.recording.dataset import DATASET_SCHEMA, DATASET_SCHEMA_1, Dataset, Episode, read, schema_of, write
from contract.sensor_layout import SensorLayout
from contract.sensors import TRUCK


def read_to_append(path: Path, facts: Mapping[str, Any], layout: SensorLayout = TRUCK) -> tuple[Episode, ...]:
    """Return the episodes of an existing data set; empty if there is no file. Raises DatasetError if the file is no
    data set, has the first schema or other sensors, or has an episode with other facts; the message states the first
    difference.

    Args:
        facts: provenance that the existing episodes must share with the new episodes, such as the flow's settings.
        layout: sensors of the new episodes.
    """
    return _to_append(path, facts, layout).episodes


def _to_append(path: Path, facts: Mapping[str, Any], layout: SensorLayout) -> Dataset:
    if not path.exists():
        return Dataset(episodes=(), layout=layout)
    there = read(path)
    schema = schema_of(path)
    if schema == DATASET_SCHEMA_1:
        raise DatasetError(
            f"{path}: schema {schema!r}, episodes can be added only to {DATASET_SCHEMA!r} and the schema before"
        )
    difference = there.layout.difference(layout)
    if difference is not None:
        raise DatasetError(f"{path}: its sensors differ from those of the new episodes, in {difference}")
    for episode in there.episodes:
        found = {name: episode.provenance[name] for name in facts if name in episode.provenance}
        for name, there, here in _differences(found, facts):
            raise DatasetError(
                f"{path}: episode {episode.name} was recorded with {name} = {there}, the new episodes have {here}: "
                f"name another file"
            )
    return there


def append(path: Path, episodes: Sequence[Episode], facts: Mapping[str, Any], layout: SensorLayout = TRUCK) -> None:
    """Add episodes at the end of a data set, or create it if there is no file. The old file remains until the new file
    is complete, and the old episodes keep their values bit for bit.

    Args: as for `read_to_append`.

    Raises:
        DatasetError: as `read_to_append` and `contract.recording.dataset.write` do, or if a name is already used.
        StillwakeError: if the file cannot be written.
    """
    there = _to_append(path, facts, layout)
    write(path, replace(there, episodes=(*there.episodes, *episodes)))


def _differences(there: Mapping[str, Any], here: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any, Any]]:
    """List the differences between two mappings as (name, value in `there`, value in `here`), with dotted names. A
    missing value is None."""
    for key in sorted(there.keys() | here.keys()):
        a, b = there.get(key), here.get(key)
        if isinstance(a, Mapping) and isinstance(b, Mapping):
            yield from _differences(a, b, f"{above}{key}.")
        elif a != b:
            yield f"{above}{key}", a, b
