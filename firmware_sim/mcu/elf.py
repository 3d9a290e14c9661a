"""As much of an ELF file (32 bit, little-endian) as loading and sizing a firmware takes."""

import struct
from dataclasses import dataclass
from typing import Final

from contract.errors import McuError

_SYMBOL_TABLE: Final = 2
_LOADABLE: Final = 1


@dataclass(frozen=True, kw_only=True)
class Segment:
    """Content to be put at an address."""

    address: int
    content: bytes


@dataclass(frozen=True, kw_only=True)
class Firmware:
    """Attributes:
    segments: what stands in flash before start.
    sections: size in bytes by name.
    symbols: address by name.
    """

    segments: tuple[Segment, ...]
    sections: dict[str, int]
    symbols: dict[str, int]


def read_elf(image: bytes) -> Firmware:
    """Raises McuError if it is no such file."""
    if image[:6] != b"\x7fELF\x01\x01":
        raise McuError("not a 32-bit little-endian ELF file")
    (segments_at, sections_at) = struct.unpack_from("<2I", image, 28)
    (segment_count,) = struct.unpack_from("<H", image, 44)
    section_count, names_index = struct.unpack_from("<2H", image, 48)
    headers = [struct.unpack_from("<10I", image, sections_at + 40 * i) for i in range(section_count)]
    segments = []
    for i in range(segment_count):
        kind, offset, _, load_address, size, _, _, _ = struct.unpack_from("<8I", image, segments_at + 32 * i)
        if kind == _LOADABLE and size:
            segments.append(Segment(address=load_address, content=image[offset : offset + size]))
    symbols = {}
    for header in headers:
        if header[1] == _SYMBOL_TABLE:
            strings = headers[header[6]][4]
            for at in range(header[4], header[4] + header[5], 16):
                name, value = struct.unpack_from("<2I", image, at)
                symbols[_text(image, strings + name)] = value
    sections = {_text(image, headers[names_index][4] + header[0]): header[5] for header in headers}
    return Firmware(segments=tuple(segments), sections=sections, symbols=symbols)


def _text(image: bytes, start: int) -> str:
    return image[start : image.index(b"\0", start)].decode()
