"""A reader of HDF5 files of unknown origin: it refuses external data and unprintable names, and limits the size."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py

from contract.arrays import MOST_VALUES
from contract.errors import DatasetError


@contextmanager
def opened(path: Path) -> Iterator[h5py.File]:
    """Open a file for reading. Raises DatasetError if the file is missing, has unprintable names, refers to other
    files, has virtual arrays, or holds more than `MOST_VALUES` values. A damaged file raises h5py's OSError,
    RuntimeError, KeyError, ValueError or TypeError."""
    if not path.is_file():
        raise DatasetError(f"{path}: no such dataset")
    values, seen = 0, set[int]()
    with h5py.File(path, "r") as file:
        groups: list[h5py.Group] = [file]
        # The groups are visited here because h5py's own visitor fails on names that are not UTF-8.
        for group in groups:
            for raw in group.id:
                name = f"{group.name.rstrip('/')}/{raw.decode('utf-8', 'surrogateescape')}"[1:]
                if not name.isprintable():
                    raise DatasetError(f"{path}: the name {name!r} is not printable text")
                kind = group.id.links.get_info(raw).type
                node = group[raw] if kind == h5py.h5l.TYPE_HARD else None
                virtual = isinstance(node, h5py.Dataset) and (node.is_virtual or node.external)
                if virtual or kind == h5py.h5l.TYPE_EXTERNAL:
                    raise DatasetError(f"{path}: {name} is virtual or in another file: copy its numbers into this file")
                if isinstance(node, h5py.Dataset):
                    # h5py reads whole chunks, and a chunk may be larger than the array.
                    size = max(node.size or 0, math.prod(node.chunks or (0,)))
                    values += max(size, size * node.dtype.itemsize // 8)
                elif isinstance(node, h5py.Group) and (place := h5py.h5o.get_info(node.id).addr) not in seen:
                    seen.add(place)
                    groups.append(node)
                if values > MOST_VALUES:
                    raise DatasetError(f"{path}: holds {values} values or more: must be at most {MOST_VALUES}")
        yield file
