"""A reader of NPZ files of unknown origin: it checks the size before it reads, and unpickles nothing."""

import math
from pathlib import Path
from typing import Any, Final
from zipfile import ZipFile

import numpy as np
import numpy.typing as npt
from numpy.lib import format as npy

from contract.arrays import MOST_VALUES, Array

_HEADERS: Final = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}


class Arrays(dict[str, npt.NDArray[Any]]):
    """The arrays of a file by name. The methods raise ValueError for a missing array, or a wrong type or shape."""

    def __missing__(self, name: str) -> npt.NDArray[Any]:
        raise ValueError(f"it lacks {name!r}")

    def numbers(self, name: str, *shape: int | None) -> Array:
        """Return an array of numbers. None in `shape` allows any length. NaN is allowed, but infinity is not."""
        array = self[name]
        fits = array.ndim == len(shape) and all(n in (None, m) for n, m in zip(shape, array.shape, strict=True))
        if array.dtype.kind not in "fiu" or not fits or np.isinf(array).any():
            wanted = ", ".join("n" if n is None else str(n) for n in shape)
            raise ValueError(f"{name!r} is {array.dtype} of shape {array.shape}: must be numbers of shape ({wanted})")
        return array.astype(np.float64)

    def text(self, name: str) -> str:
        """Return the single text in an array."""
        array = self[name]
        if array.dtype.kind != "U" or array.shape:
            raise ValueError(f"{name!r} is {array.dtype} of shape {array.shape}: must be a text")
        return str(array)


def read_npz(path: Path, *, objects: bool = False) -> Arrays:
    """Read all arrays of a file. With `objects`, an array of Python objects is read as an empty array; without
    `objects`, such an array is refused. Raises OSError if the file cannot be opened; ValueError if the file is no
    archive of arrays of numbers and texts, is damaged, or holds more than `MOST_VALUES` values."""
    if path.exists() and not path.is_file():
        raise ValueError("it is not a file")
    found, total = Arrays(), 0
    try:
        with ZipFile(path) as archive:
            for item in archive.infolist():
                with archive.open(item) as file:
                    name = item.filename.removesuffix(".npy")
                    shape, in_columns, dtype = _HEADERS[npy.read_magic(file)](file)
                    if dtype.hasobject and not objects:
                        raise ValueError(f"{name} holds Python objects, which are not read: save only numbers")
                    if dtype.hasobject:
                        found[name] = np.empty(0, dtype=object)
                        continue
                    size = math.prod(shape) * dtype.itemsize
                    total += max(math.prod(shape), size // 8)
                    if size != item.file_size - file.tell():
                        raise ValueError(f"{item.filename}: its size does not match {dtype} of shape {shape}")
                    if total > MOST_VALUES:
                        raise ValueError(f"it holds {total} values: must be at most {MOST_VALUES}")
                    values = np.frombuffer(bytearray(file.read()), dtype=dtype) if size else np.empty(0, dtype)
                found[name] = values.reshape(shape, order="F" if in_columns else "C")
    except OSError:
        raise
    except Exception as error:  # zipfile, its decompressors and numpy raise any exception for damaged files
        reason = str(error).split("\n", 1)[0] or type(error).__name__
        raise ValueError(f"damaged or not an NPZ file of numbers ({reason})") from error
    return found
