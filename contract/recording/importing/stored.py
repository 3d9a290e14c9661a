"""A reader of NPZ, HDF5, netCDF and MATLAB files, with packing, missing values and units as in CF and netCDF."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np
import numpy.typing as npt

from contract.arrays import MOST_VALUES, Array, Mask
from contract.errors import DatasetError
from contract.npz import read_npz
from contract.recording.hdf5 import opened

BINARY: Final = (".npz", ".h5", ".hdf5", ".nc", ".nc4", ".mat")
INITIAL_ACTION: Final = "initial_action"
_CDF: Final = b"CDF"
"""First bytes of netCDF's classic format; files of netCDF-4 and MATLAB 7.3 are HDF5 files."""
_HDF5: Final = b"\x89HDF"
_USER_BLOCK: Final = 512
"""Number of bytes that MATLAB writes before the HDF5 file."""
_DIMENSION: Final = "This is a netCDF dimension but not a netCDF variable"
"""Text in the attribute NAME of an array that only names a dimension."""
_TABLES: Final = ("None", "__function_workspace__")
"""Names under which SciPy lists MATLAB's tables and objects, which SciPy cannot read."""
GAP: Final = "; fill the gap, or cut the file in two there"
DEFAULT_FILL: Final = 9.9692099683868690e36
"""Value that netCDF stores in place of floating-point numbers that were never written."""
UNWRITTEN: Final = "is the default fill value of netCDF, so this value was never written"
_DEFAULT_OF_INTEGERS: Final = {2: -(2**15) + 1, 4: -(2**31) + 1, 8: -(2**63) + 2}
"""Values that netCDF stores for signed integers that were never written, by size in bytes. Bytes have no such value."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Stored:
    """An array as a file stores it. This class evaluates the attributes scale_factor, add_offset, _FillValue,
    missing_value, valid_min, valid_max, valid_range and units of CF, and _Unsigned of netCDF. If the array states no
    fill value, the default fill values of netCDF apply in a file of this format (`netcdf`)."""

    values: Any
    attributes: Mapping[str, Any] = field(default_factory=dict)
    netcdf: bool = False

    @property
    def unit(self) -> str | None:
        """The unit as the file states it; None if the file states no unit."""
        text = np.ravel(self.attributes.get("units", "")).tolist()[:1]
        unit = text[0].decode(errors="replace") if text and isinstance(text[0], bytes) else "".join(map(str, text))
        return unit.strip() or None

    @property
    def texts(self) -> tuple[str, ...]:
        """The texts of the array; empty if the array is not an array of texts."""
        values = np.asarray(self.values)
        if values.dtype == "S1" and values.ndim == 2 and values.size:  # netCDF stores a text as a row of characters
            values = np.ascontiguousarray(values).view(f"S{values.shape[1]}")
        cells = values.ravel().tolist() if values.dtype.kind in "OSU" else ()
        found = [cell.decode(errors="replace") if isinstance(cell, bytes) else cell for cell in cells]
        return tuple(cell.strip() for cell in found) if all(isinstance(cell, str) for cell in found) else ()

    def numbers(self, path: Path, name: str, *, columns: bool = False, one: bool = False) -> Array:
        """Return the unpacked numbers as a series (n,), which the file may store as one row or one column. With
        `columns`, the result is (n, sensors); with `one`, it is a single number. Raises DatasetError if the values are
        not numbers or have another shape, or if a value is missing or not finite; the message states the place."""
        raw = np.asarray(self.values)
        if raw.dtype.kind not in "fiu":
            raise DatasetError(f"{path}: array {name!r} holds {raw.dtype}, must hold numbers")
        if columns:
            if raw.ndim > 2:
                raise DatasetError(f"{path}: array {name!r} has shape {raw.shape}, must be (steps, sensors)")
            raw = raw if raw.ndim == 2 else raw.reshape(-1, 1)  # SciPy drops MATLAB's axes of length 1
        else:
            if raw.size != 1 if one else raw.ndim > 1 and raw.size != max(raw.shape):
                wanted = "one number" if one else "(steps,)"
                raise DatasetError(f"{path}: array {name!r} has shape {raw.shape}, must be {wanted}")
            raw = raw.reshape(-1)
        if self.attributes.get("_Unsigned") in ("true", b"true") and raw.dtype.kind == "i":
            raw = raw.view(raw.dtype.str.replace("i", "u"))
        scale, offset = self._number(path, name, "scale_factor", 1.0), self._number(path, name, "add_offset", 0.0)
        array = raw.astype(np.float64) * scale + offset
        gaps = {"is not finite": ~np.isfinite(array), **self._gaps(path, name, raw, array)}
        missing = np.logical_or.reduce(list(gaps.values()))
        if missing.any():
            place = tuple(np.argwhere(missing)[0])
            where = f"step {place[0]}" + (f", column {place[1]}" if columns else "")
            reason = next(text for text, mask in reversed(gaps.items()) if mask[place])
            what = "" if reason == "is not finite" else f", {raw[place]:.6g},"
            raise DatasetError(
                f"{path}: array {name!r} holds a value{what} that {reason}, first at {where} "
                f"({int(missing.sum())} of {missing.size}){GAP}"
            )
        return array

    def _gaps(self, path: Path, name: str, raw: npt.NDArray[Any], array: Array) -> dict[str, Mask]:
        """Return masks of the missing or invalid values. The name of a mask is the reason, for an error message."""
        found: dict[str, Mask] = {}
        for key in ("missing_value", "_FillValue"):
            found[f"is missing by its {key}"] = np.isin(raw, self._like(path, name, key, raw.dtype))
        if raw.dtype.kind == "f":
            found[UNWRITTEN] = np.abs(raw.astype(np.float64)) >= 0.99 * DEFAULT_FILL
        elif self.netcdf and raw.dtype.kind == "i" and "_FillValue" not in self.attributes:
            default = _DEFAULT_OF_INTEGERS.get(raw.dtype.itemsize)
            found[UNWRITTEN] = raw == default
        for key in ("valid_min", "valid_max", "valid_range"):
            bounds = self._like(path, name, key, raw.dtype)
            if bounds.size:
                low, high = bounds[0] if key != "valid_max" else -np.inf, bounds[-1] if key != "valid_min" else np.inf
                # In CF, bounds are packed like the numbers, unless the bounds have the type of the unpacked numbers.
                of = array if bounds.dtype.kind == "f" != raw.dtype.kind else raw
                found[f"is outside its {key}"] = (of < low) | (of > high)
        return found

    def _number(self, path: Path, name: str, key: str, default: float) -> float:
        values = self._like(path, name, key, np.dtype(np.float64)) if key in self.attributes else np.array([default])
        if len(values) != 1 or not np.isfinite(values[0]) or (key == "scale_factor" and values[0] == 0.0):
            raise DatasetError(f"{path}: array {name!r}: its attribute {key} {self.attributes[key]!r} must be a number")
        return float(values[0])

    def _like(self, path: Path, name: str, key: str, dtype: np.dtype[Any]) -> npt.NDArray[Any]:
        """Return an attribute's numbers, converted to the array's type if that type is floating-point or unsigned."""
        values = np.ravel(self.attributes.get(key, np.empty(0)))
        if values.dtype.kind not in "fiu":
            raise DatasetError(f"{path}: array {name!r}: its attribute {key} {self.attributes[key]!r} must be a number")
        unsigned = dtype.kind == "u" and values.dtype.kind == "i" and values.dtype.itemsize == dtype.itemsize
        with np.errstate(over="ignore"):
            return values.astype(dtype) if dtype.kind == "f" or unsigned else values


def stored_arrays(path: Path) -> dict[str, Stored]:
    """Return all arrays by name. Names include the groups or structures. Raises DatasetError for an unreadable file."""
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
            netcdf, names, read = "_NCProperties" in file.attrs, list[str](), dict[int, Stored]()
            # An array may have several names, and a soft link is such a name, too.
            file.visit_links(names.append)
            for name in names:
                if not name.startswith("#") and (node := _array(file, name)) is not None:
                    place = h5py.h5o.get_info(node.id).addr
                    if place not in read:
                        read[place] = Stored(values=_values(file, node), attributes=_attributes(node), netcdf=netcdf)
                    found[name] = read[place]
            if INITIAL_ACTION in file.attrs:
                found[INITIAL_ACTION] = Stored(values=file.attrs[INITIAL_ACTION])
    except (OSError, RuntimeError, KeyError, ValueError, TypeError) as error:
        raise DatasetError(f"{path}: is damaged or not an HDF5 file ({_first_line(error)})") from error
    return found


def _array(file: h5py.File, name: str) -> h5py.Dataset | None:
    """Return the array with this name; None for a group, a dead link, or an array that only names a dimension."""
    try:
        node = file[name]
    except (KeyError, RuntimeError):
        return None
    is_array = isinstance(node, h5py.Dataset) and _DIMENSION not in str(_attributes(node).get("NAME"))
    return node if is_array else None


def _values(file: h5py.File, node: h5py.Dataset) -> Any:
    """Return the array. In an array that MATLAB wrote, the axes get MATLAB's order, and characters become texts."""
    kind = node.attrs.get("MATLAB_class", b"")
    kind = kind.decode() if isinstance(kind, bytes) else str(kind)
    if kind == "cell" and node.dtype.kind == "O":
        return np.array([_text(file[one]) for one in np.ravel(node[()])], dtype=object)
    if kind == "char":
        return _text(node)
    return np.asarray(node[()]).T if kind else node[()]


def _text(node: Any) -> Any:
    """Return MATLAB's characters as a text; None if a cell contains anything else."""
    values = np.ravel(node[()]) if isinstance(node, h5py.Dataset) else np.empty(0)
    return "".join(map(chr, values.tolist())) if values.dtype == np.uint16 else None


def _attributes(node: h5py.Dataset) -> dict[str, Any]:
    """Return the attributes. The fill value with which the array was created counts as `_FillValue`, unless it is 0."""
    found: dict[str, Any] = {}
    for name in node.attrs:
        try:
            found[name] = node.attrs[name]
        except (OSError, RuntimeError, TypeError, ValueError):
            continue  # h5py does not know the attribute's type; no attribute of CF has such a type
        if isinstance(found[name], h5py.Empty):  # netCDF stores an empty text in this way
            del found[name]
    fill = node.fillvalue if node.dtype.kind in "fiu" else 0
    return found if not fill or fill != fill else {"_FillValue": fill, **found}


def _read_classic(path: Path) -> dict[str, Stored]:
    from scipy.io import netcdf_file

    if path.stat().st_size > 8 * MOST_VALUES:
        raise ValueError(f"holds more values than {MOST_VALUES}")
    try:
        with netcdf_file(path, mmap=False) as file:
            found = {}
            for name, one in file.variables.items():
                values = np.array(one[:] if one.shape else one.getValue())
                found[_in_utf8(name)] = Stored(values=values, attributes=one._attributes, netcdf=True)
            return found
    except Exception as error:  # SciPy raises any exception for damaged files
        raise ValueError(f"is damaged or not a netCDF file ({_first_line(error)})") from error


def _in_utf8(name: str) -> str:
    """Return the name of a netCDF variable. SciPy reads and writes Latin-1, but netCDF's names are UTF-8."""
    try:
        return name.encode("latin-1").decode()
    except UnicodeDecodeError:
        return name


def _read_matlab(path: Path) -> dict[str, Stored]:
    from scipy.io import loadmat, whosmat

    try:
        values = sum(math.prod(shape) for _, shape, _ in whosmat(path))
        found = loadmat(path, simplify_cells=True) if values <= MOST_VALUES else None
    except Exception as error:  # SciPy raises any exception for damaged files
        raise ValueError(f"is damaged or not a MATLAB file ({_first_line(error)})") from error
    if found is None:
        raise ValueError(f"holds {values} values: must be at most {MOST_VALUES}")
    # SciPy makes a list of a cell array whose first cell is a structure. The other cells may have any shape.
    arrays = ((name, np.array(one, object) if isinstance(one, list) else one) for name, one in _flat(found))
    return {name: Stored(values=values) for name, values in arrays}


def _flat(found: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    for name, values in found.items():
        if name in _TABLES:
            yield "a MATLAB table or object, whose columns only MATLAB can read: save them as variables", None
        elif isinstance(values, Mapping):
            yield from _flat(values, f"{above}{name}/")
        elif not name.startswith("__"):
            yield f"{above}{name}", values


def _first_line(error: Exception) -> str:
    return str(error).split("\n", 1)[0]
