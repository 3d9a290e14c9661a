"""The record of calibrations: one a release, tied to its digest, so that no release runs with another one's.

"SWC1" (4), number of calibrations (1)
for each, by digest: digest (32), length (2), bytes
"""

import struct
from collections.abc import Mapping
from typing import Final

MAX_CALIBRATION: Final = 1024
"""Bytes of one."""
_MAGIC: Final = b"SWC1"
_HEAD: Final = struct.Struct(">4sB")
_ENTRY: Final = struct.Struct(">32sH")


def encode(kept: Mapping[str, bytes]) -> bytes:
    """The record of calibrations by digest; raises ValueError for one that is too long."""
    parts = [_HEAD.pack(_MAGIC, len(kept))]
    for digest, blob in sorted(kept.items()):
        if len(blob) > MAX_CALIBRATION:
            raise ValueError(f"calibration of {digest[:8]}: {len(blob)} bytes, must be at most {MAX_CALIBRATION}")
        parts.append(_ENTRY.pack(bytes.fromhex(digest), len(blob)) + blob)
    return b"".join(parts)


def decode(raw: bytes) -> dict[str, bytes]:
    """Calibrations by digest; raises ValueError if the record is damaged."""
    kept = {}
    try:
        magic, count = _HEAD.unpack_from(raw)
        at = _HEAD.size
        for _ in range(count):
            digest, length = _ENTRY.unpack_from(raw, at)
            at += _ENTRY.size
            if length > MAX_CALIBRATION:
                raise ValueError(f"calibration of {length} bytes: must have at most {MAX_CALIBRATION}")
            kept[digest.hex()] = raw[at : at + length]
            at += length
    except struct.error as error:
        raise ValueError(f"calibrations: {len(raw)} bytes, of which the last are missing") from error
    if magic != _MAGIC or at != len(raw):
        raise ValueError(f"calibrations: {len(raw)} bytes, {at} used, must begin with {_MAGIC.decode()}")
    return kept
