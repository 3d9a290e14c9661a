"""Images as lines of text, which workshop and flash tools read: Intel HEX, and Motorola S-records in the form S37.

Addresses are offsets in the image and begin at 0, as in a download through UDS. They are not addresses in the memory of
an ECU.
"""

from collections.abc import Callable, Mapping
from typing import Final

from contract.release.controller_image import SUFFIX

LINE: Final = 32
"""Number of bytes in a line. Every tool accepts 32, and 64 KiB is a multiple of 32."""
HIGH: Final = 1 << 16
"""Number of addresses that an Intel HEX line can state. The higher part of an address is in a line of another type."""


def intel_hex(content: bytes) -> bytes:
    """Return the content as Intel HEX with extended linear addresses (I32HEX)."""
    lines = []
    for at in range(0, len(content), LINE):
        if at % HIGH == 0:
            lines.append(_hex_line(4, 0, (at // HIGH).to_bytes(2, "big")))
        lines.append(_hex_line(0, at % HIGH, content[at : at + LINE]))
    return "".join([*lines, _hex_line(1, 0)]).encode()


def s_records(content: bytes) -> bytes:
    """Return the content as S-records with addresses of 32 bits."""
    lines = (_s_line(3, at.to_bytes(4, "big") + content[at : at + LINE]) for at in range(0, len(content), LINE))
    return "".join([_s_line(0, b"\0\0stillwake"), *lines, _s_line(7, bytes(4))]).encode()


FORMATS: Final[Mapping[str, Callable[[bytes], bytes]]] = {SUFFIX: bytes, ".hex": intel_hex, ".s19": s_records}
"""Functions that convert an image to the content of a file, by the suffix of the file's name."""


def _hex_line(kind: int, address: int, data: bytes = b"") -> str:
    body = bytes([len(data), *address.to_bytes(2, "big"), kind]) + data
    return f":{(body + bytes([-sum(body) % 256])).hex().upper()}\n"


def _s_line(kind: int, rest: bytes) -> str:
    body = bytes([len(rest) + 1]) + rest
    return f"S{kind}{(body + bytes([255 - sum(body) % 256])).hex().upper()}\n"
