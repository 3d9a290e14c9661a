"""An array as a file stores it: packed, with gaps and a unit, as the CF conventions and netCDF write them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from contract.arrays import Array, Mask
from contract.errors import DatasetError

GAP: Final = "; fill the gap, or cut the file in two there"
DEFAULT_FILL: Final = 9.9692099683868690e36
"""What netCDF puts where nothing was written, for floating-point numbers."""
UNWRITTEN: Final = "is the default fill value of netCDF: nothing was written there"
_DEFAULT_OF_INTEGERS: Final = {2: -(2**15) + 1, 4: -(2**31) + 1, 8: -(2**63) + 2}
"""The same for signed integers, by their bytes; single bytes have none."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Stored:
    """One array.

    Attributes:
        values: as they are stored.
        attributes: of the array, by name; those of CF count: scale_factor, add_offset, _FillValue, missing_value,
            valid_min, valid_max, valid_range, units, and netCDF's _Unsigned.
        netcdf: whether netCDF wrote it, with its own fill values where none is named.
    """

    values: Any
    attributes: Mapping[str, Any] = field(default_factory=dict)
    netcdf: bool = False

    @property
    def unit(self) -> str | None:
        """As the file states it; None if it states none."""
        text = np.ravel(self.attributes.get("units", "")).tolist()[:1]
        unit = text[0].decode(errors="replace") if text and isinstance(text[0], bytes) else "".join(map(str, text))
        return unit.strip() or None

    @property
    def texts(self) -> tuple[str, ...]:
        """Its texts, if it holds texts alone."""
        values = np.asarray(self.values).ravel()
        cells = values.tolist() if values.dtype.kind in "OSU" else ()
        found = [cell.decode(errors="replace") if isinstance(cell, bytes) else cell for cell in cells]
        return tuple(cell.strip() for cell in found) if all(isinstance(cell, str) for cell in found) else ()

    def numbers(self, path: Path, name: str, *, columns: bool = False, one: bool = False) -> Array:
        """The numbers that are meant: as a series (n,), which may be one row or one column, with columns as (n,
        sensors), or one number. Raises DatasetError if these are no numbers, of another shape, or one is missing or
        not finite; the message names the place."""
        raw = np.asarray(self.values)
        if raw.dtype.kind not in "fiu":
            raise DatasetError(f"{path}: array {name!r} holds {raw.dtype}, must hold numbers")
        if columns:
            if raw.ndim != 2:
                raise DatasetError(f"{path}: array {name!r} has shape {raw.shape}, must be (steps, sensors)")
        else:
            if raw.size != 1 if one else raw.ndim != 1 and raw.size != max(raw.shape, default=0):
                wanted = "one number" if one else "(steps,)"
                raise DatasetError(f"{path}: array {name!r} has shape {raw.shape}, must be {wanted}")
            raw = raw.reshape(-1)
        if self.attributes.get("_Unsigned") in ("true", b"true") and raw.dtype.kind == "i":
            raw = raw.view(raw.dtype.str.replace("i", "u"))
        scale, offset = (self._number(path, name, key, default) for key, default in _PACKING)
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
        """Where a value stands for none, by the reason."""
        found: dict[str, Mask] = {}
        for key in ("missing_value", "_FillValue"):
            found[f"is missing by its {key}"] = np.isin(raw, self._like(path, name, key, raw.dtype))
        if raw.dtype.kind == "f":
            found[UNWRITTEN] = np.abs(raw) >= 0.99 * DEFAULT_FILL
        elif self.netcdf and raw.dtype.kind == "i" and "_FillValue" not in self.attributes:
            default = _DEFAULT_OF_INTEGERS.get(raw.dtype.itemsize)
            found[UNWRITTEN] = raw == default
        for key in ("valid_min", "valid_max", "valid_range"):
            bounds = self._like(path, name, key, raw.dtype)
            if bounds.size:
                low, high = bounds[0] if key != "valid_max" else -np.inf, bounds[-1] if key != "valid_min" else np.inf
                # CF: bounds are packed as the numbers are, unless their type is that of the unpacked ones.
                of = array if bounds.dtype.kind == "f" != raw.dtype.kind else raw
                found[f"is outside its {key}"] = (of < low) | (of > high)
        return found

    def _number(self, path: Path, name: str, key: str, default: float) -> float:
        values = self._like(path, name, key, np.dtype(np.float64)) if key in self.attributes else np.array([default])
        if len(values) != 1 or not np.isfinite(values[0]) or (key == "scale_factor" and values[0] == 0.0):
            raise DatasetError(f"{path}: array {name!r}: its attribute {key} is {self.attributes[key]!r}, no number")
        return float(values[0])

    def _like(self, path: Path, name: str, key: str, dtype: np.dtype[Any]) -> npt.NDArray[Any]:
        """The numbers of an attribute, as those of the array are where that changes what they are."""
        values = np.ravel(self.attributes.get(key, np.empty(0)))
        if values.dtype.kind not in "fiu":
            raise DatasetError(f"{path}: array {name!r}: its attribute {key} is {self.attributes[key]!r}, no number")
        unsigned = dtype.kind == "u" and values.dtype.kind == "i" and values.dtype.itemsize == dtype.itemsize
        with np.errstate(over="ignore"):
            return values.astype(dtype) if dtype.kind == "f" or unsigned else values


_PACKING: Final = (("scale_factor", 1.0), ("add_offset", 0.0))
