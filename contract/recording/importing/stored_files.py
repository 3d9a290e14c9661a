"""NPZ, HDF5, netCDF and MATLAB files as arrays by their names."""

import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np

from contract.arrays import MOST_VALUES
from contract.errors import DatasetError
from contract.npz import read_npz
from contract.recording.hdf5 import opened
from contract.recording.importing.stored import Stored

BINARY: Final = (".npz", ".h5", ".hdf5", ".nc", ".nc4", ".mat")
INITIAL_ACTION: Final = "initial_action"
_CDF: Final = b"CDF"
"""First bytes of netCDF's classic format; netCDF-4 is HDF5, and so is MATLAB 7.3."""
_HDF5: Final = b"\x89HDF"
_USER_BLOCK: Final = 512
"""Bytes that MATLAB puts before the HDF5 file."""
_TABLES: Final = ("None", "__function_workspace__")
"""What SciPy calls MATLAB's tables and objects, which it cannot read."""


def stored_arrays(path: Path) -> dict[str, Stored]:
    """All arrays of a file by their names, with those of the groups or structures that they are in. Raises DatasetError
    if the file cannot be read."""
    try:
        with path.open("rb") as file:
            head = file.read(_USER_BLOCK + len(_HDF5))
        if path.suffix.lower() == ".npz":
            return {name: Stored(values=values) for name, values in read_npz(path, objects=True).items()}
        if head.startswith(_CDF):
            return _read_classic(path)
        if path.suffix.lower() == ".mat" and not (head.startswith(_HDF5) or head.endswith(_HDF5)):
            return _read_matlab(path)
    except (OSError, ValueError) as error:
        raise DatasetError(f"{path}: {_first_line(error)}") from error
    return _read_hdf5(path)


def _read_hdf5(path: Path) -> dict[str, Stored]:
    found: dict[str, Stored] = {}
    try:
        with opened(path) as file:
            netcdf = "_NCProperties" in file.attrs

            def keep(name: str, node: object) -> None:
                if isinstance(node, h5py.Dataset) and not name.startswith("#"):
                    found[name] = Stored(values=_values(file, node), attributes=_attributes(node), netcdf=netcdf)

            visit: Callable[[str, object], None] = keep
            file.visititems(visit)
            if INITIAL_ACTION in file.attrs:
                found[INITIAL_ACTION] = Stored(values=file.attrs[INITIAL_ACTION])
    except (OSError, RuntimeError, KeyError, ValueError, TypeError) as error:
        raise DatasetError(f"{path}: damaged or not an HDF5 file ({_first_line(error)})") from error
    return found


def _values(file: h5py.File, node: h5py.Dataset) -> Any:
    """The array; of MATLAB with its axes in MATLAB's order, and texts in place of characters and cells of them."""
    kind = node.attrs.get("MATLAB_class", b"")
    kind = kind.decode() if isinstance(kind, bytes) else str(kind)
    if kind == "cell" and node.dtype.kind == "O":
        return np.array([_text(file[one]) for one in np.ravel(node[()])], dtype=object)
    if kind == "char":
        return _text(node)
    return np.asarray(node[()]).T if kind else node[()]


def _text(node: Any) -> Any:
    """Characters of MATLAB as a text; None for anything else in a cell."""
    values = np.ravel(node[()]) if isinstance(node, h5py.Dataset) else np.empty(0)
    return "".join(map(chr, values.tolist())) if values.dtype == np.uint16 else None


def _attributes(node: h5py.Dataset) -> dict[str, Any]:
    """Those of the array; a fill value that the file was created with counts as one, 0 means that none was chosen."""
    found: dict[str, Any] = {}
    for name in node.attrs:
        try:
            found[name] = node.attrs[name]
        except (OSError, RuntimeError, TypeError, ValueError):
            continue  # of a kind that h5py does not know: none of CF's
    fill = node.fillvalue if node.dtype.kind in "fiu" else 0
    return found if not fill or fill != fill else {"_FillValue": fill, **found}


def _read_classic(path: Path) -> dict[str, Stored]:
    from scipy.io import netcdf_file

    if path.stat().st_size > 8 * MOST_VALUES:
        raise ValueError(f"holds more values than {MOST_VALUES}")
    try:
        with netcdf_file(path, mmap=False) as file:
            return {
                name: Stored(
                    values=np.array(one[:] if one.shape else one.getValue()), attributes=one._attributes, netcdf=True
                )
                for name, one in file.variables.items()
            }
    except Exception as error:  # SciPy raises what it likes for damaged files
        raise ValueError(f"damaged or not a netCDF file ({_first_line(error)})") from error


def _read_matlab(path: Path) -> dict[str, Stored]:
    from scipy.io import loadmat, whosmat

    try:
        values = sum(math.prod(shape) for _, shape, _ in whosmat(path))
        found = loadmat(path, simplify_cells=True) if values <= MOST_VALUES else None
    except Exception as error:  # SciPy raises what it likes for damaged files
        raise ValueError(f"damaged or not a MATLAB file ({_first_line(error)})") from error
    if found is None:
        raise ValueError(f"holds {values} values: must be at most {MOST_VALUES}")
    return {name: Stored(values=values) for name, values in _flat(found)}


def _flat(found: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """The arrays of nested structures, their names joined by slashes as those of HDF5's groups are."""
    for name, values in found.items():
        if name in _TABLES:
            yield "a MATLAB table or object, of which only MATLAB can read the columns: save them as variables", None
        elif isinstance(values, Mapping):
            yield from _flat(values, f"{above}{name}/")
        elif not name.startswith("__"):
            yield f"{above}{name}", values


def _first_line(error: Exception) -> str:
    return str(error).split("\n", 1)[0]
