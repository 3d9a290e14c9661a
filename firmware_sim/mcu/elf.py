"""A reader of the parts of an ELF file that are needed to load a firmware and to measure its size."""

import io
from dataclasses import dataclass
from typing import Any, Final

from elftools.common.exceptions import ELFError
from elftools.elf.elffile import ELFFile

from contract.errors import McuError

_BITS: Final = 32


@dataclass(frozen=True, kw_only=True)
class Firmware:
    """A linked program: contents of the flash as (address, bytes), sections' sizes in bytes, symbols' addresses."""

    segments: tuple[tuple[int, bytes], ...]
    sections: dict[str, int]
    symbols: dict[str, int]


def read_elf(image: bytes) -> Firmware:
    """Parse an ELF file. Raises McuError if it is not a complete 32-bit little-endian ELF file."""
    try:
        # The type is Any because pyelftools has no type annotations.
        elf: Any = ELFFile(io.BytesIO(image))
        if elf.elfclass != _BITS or not elf.little_endian:
            order = "little" if elf.little_endian else "big"
            raise McuError(f"not a 32-bit little-endian ELF file: {elf.elfclass}-bit, {order}-endian")
        loaded = (item for item in elf.iter_segments("PT_LOAD") if item["p_filesz"])
        tables = elf.iter_sections("SHT_SYMTAB")
        return Firmware(
            segments=tuple((item["p_paddr"], item.data()) for item in loaded),
            sections={item.name: item["sh_size"] for item in elf.iter_sections()},
            symbols={item.name: item["st_value"] for table in tables for item in table.iter_symbols()},
        )
    except ELFError as error:
        raise McuError(f"not a 32-bit little-endian ELF file: {error}") from error
