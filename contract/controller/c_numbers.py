"""The parameters of a release as a C struct: the source text of a constant, and the constant's bytes after compilation.
Text and bytes are built from one description, so compiled-in parameters equal those of an image
(`contract.controller.image_payload`)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from contract.controller.c_folder import float_literal

_LINE: Final = 16
_TYPES: Final = {"float64": "double", "float32": "float"}


@dataclass(frozen=True, kw_only=True, eq=False)
class Numbers:
    """A C struct of arrays.

    Attributes:
        struct: name of the struct's type in C.
        members: values by the members' names, in the order of the struct and with the types in C.
        alignment: alignment of every member in bytes; None uses the alignment of each member's type.
    """

    struct: str
    members: Mapping[str, npt.NDArray[Any]]
    alignment: int | None = None

    def definition(self, name: str) -> str:
        """Return the C definition of a constant with the struct's values, and a compile-time check of its layout."""
        check = f"typedef char {name}_as_packed[{self.as_packed} ? 1 : -1];"
        return f"const {self.struct} {name} = {self.initialiser};\n\n#if defined(__GNUC__)\n{check}\n#endif"

    @property
    def initialiser(self) -> str:
        members = (f".{name} = {_initialiser(values)}" for name, values in self.members.items())
        return "{" + ",\n".join(members) + "}"

    @property
    def as_packed(self) -> str:
        """A C expression that is true if the compiler's layout of the struct equals the layout of `packed`."""
        places, size = self._places()
        places_in_c = (f"offsetof({self.struct}, {name}) == {place}" for name, place in places.items())
        return f"({' && '.join([*places_in_c, f'sizeof({self.struct}) == {size}'])})"

    def packed(self) -> bytes:
        """Return the struct's bytes, little-endian, with zeros as padding."""
        places, size = self._places()
        content = bytearray(size)
        for name, values in self.members.items():
            data = values.astype(values.dtype.newbyteorder("<")).tobytes()
            content[places[name] : places[name] + len(data)] = data
        return bytes(content)

    def settings(self, prefix: str) -> dict[str, int | str]:
        """Return definitions for a header: the struct's size, and the name, type, shape and offset of each member."""
        places, size = self._places()
        members = (
            f"{name} {values.dtype} {'x'.join(map(str, values.shape or (1,)))} {places[name]}"
            for name, values in self.members.items()
        )
        return {f"{prefix}_BYTES": size, f"{prefix}_LAYOUT": "; ".join(members)}

    def _places(self) -> tuple[dict[str, int], int]:
        places, end, widest = {}, 0, 1
        for name, values in self.members.items():
            alignment = self.alignment or values.dtype.itemsize
            places[name] = end + -end % alignment
            end, widest = places[name] + values.nbytes, max(widest, alignment)
        return places, end + -end % widest


def numbers_source(what: str, includes: Sequence[str], constants: Mapping[str, Numbers], tables: str = "") -> bytes:
    """Return a C source file that defines constants by name."""
    lines = [f"/* Generated: {what}. */", "\n".join(f"#include {name}" for name in ("<stddef.h>", *includes))]
    parts = [*lines, tables, *(values.definition(name) for name, values in constants.items())]
    return ("\n\n".join(part for part in parts if part) + "\n").encode()


def table(name: str, values: npt.NDArray[Any]) -> str:
    """Return the C definition of a single constant array."""
    sides = "".join(f"[{size}]" for size in values.shape)
    return f"const SW_ALIGNED {_type(values)} {name}{sides} = {_initialiser(values)};"


def _type(values: npt.NDArray[Any]) -> str:
    return _TYPES.get(str(values.dtype), f"{values.dtype}_t")


def _initialiser(values: npt.NDArray[Any]) -> str:
    if values.ndim == 0:
        return float_literal(np.float32(values)) if values.dtype == np.float32 else repr(values.item())
    if values.ndim > 1:
        return "{\n" + ",\n".join(map(_initialiser, values)) + "}"
    lines = (values[start : start + _LINE] for start in range(0, len(values), _LINE))
    return "{" + ",\n ".join(", ".join(map(_initialiser, line)) for line in lines) + "}"
