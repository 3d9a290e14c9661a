"""The file names and formats in a C library's folder. The library has a control step in C99 and usually the whole ECU.

`export` writes the folder; the ECU and the emulated microcontroller read it. The sources are equal for all programs,
except the generated `sw_settings.h` and `sw_weights.c`; `stillwake.h` describes the calls. Folders of older versions
have no `expected.txt` and no documents; this module does not need these files. A folder with `sw_ecu_settings.h` also
has the whole ECU: `sw_ecu.h`, the sources of the ECU, and programs with a `main` function in `examples/`.

The parameters of a release are constant C structs. One description (`Numbers`) gives a struct's source text and its
compiled bytes, so compiled-in parameters equal those in an image (`contract.controller.image_payload`).
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from contract.atomic import write_files
from contract.errors import LibraryError
from contract.printable import quoted, shown

PROGRAM_SETTINGS: Final = "sw_settings.h"
"""Header with sizes and settings of one program, and the hashes of that program and of the DBC."""
ECU_SETTINGS: Final = "sw_ecu_settings.h"
"""Header with DBC messages, release figures and vehicle settings. Only folders with the ECU have this header."""
PROGRAM_WEIGHTS: Final = "sw_weights.c"
"""Source file with the arrays that `sw_weights.h` declares."""
REPLAY: Final = "replay.c"
"""Example program that is not part of the library. It runs control steps from recorded rows on a host."""
RECORDED: Final = "recorded.txt"
"""Input rows of the example program. Each row has the pressures, then the action of the previous step."""
NO_LIBRARY: Final = "this is not a folder written by `stillwake export --c`"
EXPECTED: Final = "expected.txt"
"""Expected answers of the example program to the recorded rows."""
DOCUMENTS: Final = ("README.md", "CMakeLists.txt", "LICENSE", "zephyr/module.yml", "zephyr/CMakeLists.txt")
"""Files of the folder that are not compiled. They are equal for all libraries, except for sizes in the text."""
BILL: Final = "sbom.cdx.json"
"""Name of the folder's bill of materials, in CycloneDX."""
BOARD: Final = ("board", "loader")
"""Folders with code for a board (drivers, start-up, main loop), and with code for flashing and diagnosis."""
COMPILE_FLAGS: Final = "compile_flags.txt"
"""Name of the file with compiler flags for editors (clangd), one flag per line; only in sample folders."""
ProgramRows = npt.NDArray[np.float32]
_MAX_BYTES: Final = 64 * 2**20
"""Largest size of a folder's sources, in bytes. The text of the paper's weights takes a few megabytes."""
_NUMBER: Final = re.compile("[0-9]{1,9}")
_ESCAPED: Final = re.compile(r"\\(.)")
_DEFINITION: Final = re.compile(r"^#define (SW_\w+) (\S.*)$", re.MULTILINE)


class ProgramSettings:
    """The definitions of a generated header. Raises LibraryError if a requested definition is missing or invalid."""

    def __init__(self, header: bytes) -> None:
        try:
            self.definitions: dict[str, str] = dict(_DEFINITION.findall(header.decode("utf-8")))
        except UnicodeDecodeError as error:
            raise LibraryError(f"{PROGRAM_SETTINGS}: is not text ({error})") from error

    @classmethod
    def of(cls, contents: Mapping[str, bytes]) -> "ProgramSettings":
        """Read the definitions from a library's files. Raises LibraryError if the header is missing."""
        if PROGRAM_SETTINGS not in contents:
            raise LibraryError(f"{PROGRAM_SETTINGS} is missing: {NO_LIBRARY}")
        return cls(contents[PROGRAM_SETTINGS])

    def text(self, name: str) -> str:
        if name not in self.definitions:
            raise LibraryError(f"{PROGRAM_SETTINGS}: {name} is missing")
        value = self.definitions[name]
        return _ESCAPED.sub(r"\1", value[1:-1]) if len(value) > 1 and value[0] == value[-1] == '"' else value

    def number(self, name: str) -> int:
        value = self.text(name)
        if not _NUMBER.fullmatch(value):
            wanted = "must be a whole number of at most nine digits"
            raise LibraryError(f"{PROGRAM_SETTINGS}: {name} is {quoted(value)}: {wanted}")
        return int(value)

    def multiply_accumulates(self) -> int:
        """Count a control step's multiplications by weights, in the encoder, all roll-outs and all adjoint passes."""
        names = ("WINDOW", "SENSORS", "LSTM", "HEAD", "LATENT", "DYN1", "DYN2", "DECODER", "BLOCKS")
        window, sensors, lstm, head, latent, dyn1, dyn2, decoder, blocks = (self.number(f"SW_{one}") for one in names)
        encoder = window * 4 * lstm * (sensors + 1 + lstm) + head * (lstm + latent)
        dynamics = dyn1 * (latent + 1) + dyn2 * (dyn1 + latent)
        outputs = decoder * (latent + blocks * decoder + 2)
        passes = 2 * self.number("SW_ITERATIONS") + 1
        return encoder + passes * self.number("SW_HORIZON") * (dynamics + outputs)


def settings_header(definitions: Mapping[str, int | str | np.float32]) -> bytes:
    """Return the content of `sw_settings.h`, in the form that `ProgramSettings` reads. Text values are quoted."""
    literals = {name: _literal(value) for name, value in definitions.items()}
    return generated_header(PROGRAM_SETTINGS, "sizes and settings of one trained program", literals)


def generated_header(name: str, what: str, definitions: Mapping[str, object]) -> bytes:
    """Return a header `name` with a `#define` for each definition. Values are written unchanged, as text."""
    guard = name.upper().replace(".", "_")
    lines = "\n".join(f"#define {key} {value}" for key, value in definitions.items())
    return f"/* Generated: {what}. */\n#ifndef {guard}\n#define {guard}\n\n{lines}\n\n#endif\n".encode()


def _literal(value: int | str | np.float32) -> str:
    if isinstance(value, np.float32):
        return float_literal(value)
    # An unescaped question mark could begin a trigraph, which C99 reads as another character.
    return '"' + re.sub(r'(["\\?])', r"\\\1", value) + '"' if isinstance(value, str) else str(value)


def float_literal(value: np.float32) -> str:
    """Return the shortest C literal that gives exactly this float32."""
    return f"{np.format_float_scientific(value, trim='0')}f"


def c_files(folder: Traversable) -> dict[str, bytes]:
    """Return the sources, headers and linker scripts of a folder, by name."""
    return {item.name: item.read_bytes() for item in folder.iterdir() if item.name.endswith((".c", ".h", ".ld"))}


def library_sources(contents: Mapping[str, bytes]) -> dict[str, bytes]:
    """Return the files that are compiled into the library: sources and headers without the example programs."""
    compiled = {name for name in contents if name.endswith((".c", ".h")) and name != REPLAY and "/" not in name}
    return {name: content for name, content in contents.items() if name in compiled}


def read_sources(folder: Path, *, board: bool = False) -> dict[str, bytes]:
    """Read all sources and headers of a folder by name. With `board`, the sources and headers in the folders `BOARD`
    are also read, by their paths. Raises LibraryError if the folder cannot be read or is too large."""
    try:
        found = [item for item in folder.iterdir() if item.suffix in (".c", ".h")]
        for part in BOARD if board else ():
            found += [item for item in (folder / part).glob("*") if item.suffix in (".c", ".h", ".ld")]
        for item in found:
            if not item.is_file():
                raise LibraryError(f"library {folder}: {quoted(item.name)} is not a plain file")
        if sum(item.stat().st_size for item in found) > _MAX_BYTES:
            raise LibraryError(f"library {folder}: its sources have more than {_MAX_BYTES} bytes")
        return {item.relative_to(folder).as_posix(): item.read_bytes() for item in found}
    except OSError as error:
        raise LibraryError(f"library {folder}: {error.strerror or error}") from error


def read_recorded(folder: Path) -> ProgramRows:
    """Read the n recorded rows of a folder, (n, S+1): pressures Cp at the S sensors, then the action of the previous
    step in U_inf W. Raises LibraryError if there are no rows, or a row has anything but numbers."""
    path = folder / RECORDED
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise LibraryError(f"{path}: has more than {_MAX_BYTES} bytes")
        text = path.read_text(encoding="utf-8")
        if not text.strip():
            raise ValueError("holds no rows")
        return rows_from_text(text)
    except FileNotFoundError as error:
        if not folder.is_dir():
            raise LibraryError(f"library {folder}: No such file or directory") from error
        raise LibraryError(f"library {folder}: {RECORDED} is missing: {NO_LIBRARY}") from error
    except (OSError, ValueError) as error:
        raise LibraryError(f"{path}: {shown(getattr(error, 'strerror', None) or error)}") from error


def rows_text(rows: npt.NDArray[np.floating]) -> str:
    """Format rows as in `recorded.txt`, the example program's input: one row per line, with the digits of float32."""
    return "".join(" ".join(f"{value:.9g}" for value in row) + "\n" for row in rows.astype(np.float64))


def rows_from_text(text: str) -> ProgramRows:
    """Parse rows of numbers as the example program reads and prints them. Raises ValueError for other text."""
    return np.loadtxt(text.splitlines(), dtype=np.float32, ndmin=2)


def check_replaceable(folder: Path) -> None:
    """Raise LibraryError if the folder is neither empty nor a library, because its files would be deleted."""
    if folder.is_dir() and any(folder.iterdir()) and not (folder / PROGRAM_SETTINGS).is_file():
        raise LibraryError(f"{folder}: that directory holds other files; name another directory")


def write_folder(folder: Path, contents: Mapping[str, bytes]) -> None:
    """Write a library's folder, completely or not at all. A file's name may include one subfolder. Raises LibraryError
    if the folder is neither empty nor a library; StillwakeError if the folder cannot be written."""
    check_replaceable(folder)
    write_files(folder, contents)


@dataclass(frozen=True, kw_only=True, eq=False)
class Numbers:
    """A C struct of arrays. `struct` is the name of its type in C. `members` has the arrays by the members' names, in
    the struct's order; an array's type is the member's type in C. `alignment` is the alignment of every member in
    bytes; None uses the alignment of each member's type."""

    struct: str
    members: Mapping[str, npt.NDArray[Any]]
    alignment: int | None = None

    def definition(self, name: str) -> str:
        """Return the C definition of a constant with the struct's values, and a compile-time check of the layout."""
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
    kind = {"float64": "double", "float32": "float"}.get(str(values.dtype), f"{values.dtype}_t")
    return f"const SW_ALIGNED {kind} {name}{sides} = {_initialiser(values)};"


def _initialiser(values: npt.NDArray[Any]) -> str:
    if values.ndim == 0:
        return float_literal(np.float32(values)) if values.dtype == np.float32 else repr(values.item())
    if values.ndim > 1:
        return "{\n" + ",\n".join(map(_initialiser, values)) + "}"
    lines = (values[start : start + 16] for start in range(0, len(values), 16))
    return "{" + ",\n ".join(", ".join(map(_initialiser, line)) for line in lines) + "}"
