"""The image of a release for a microcontroller: a header of 512 bytes, then numbers that C reads without copying.

    0   8   "SWCTRL01"
    8   4   length of the whole image
    12  4   length of the header, 512
    16  32  SHA-256 of the payload, which is everything after the header
    48  32  SHA-256 that identifies the build's layout of the payload
    80  32  SHA-256 of stillwake.dbc
    112 32  digest of the release
    144 4   security version
    148 8   control period in ns
    156 24  operating point: width in m, speed in m/s, density in kg/m3, as float64
    180 8   action limit in free-stream speed times width, as float64
    188 4   number of sensors
    192 64  name of the hardware; zeros: any
    256 64  name of the release
    320 96  zeros
    416 32  Ed25519 public key of the signer; zeros: unsigned
    448 64  Ed25519 signature of all bytes before it; zeros: unsigned

Numbers are little-endian, like the processors that read them; names are printable ASCII, padded with zeros.

Workshop and flash tools read an image as lines of text: Intel HEX or Motorola S-records (S37). Addresses in these lines
are offsets in the image, as in a download through UDS, and not addresses in the memory of an ECU.
"""

import hashlib
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from contract.errors import BundleContainerError, BundleSignatureError
from contract.printable import quoted
from contract.release import signing
from contract.release.signing import PublicKey

SUFFIX: Final = ".swi"
HEADER_BYTES: Final = 512
VEHICLE: Final = slice(148, 192)
"""The part of the header that an ECU compares with its vehicle settings: control period to number of sensors."""
_MAX_NAME: Final = 64
_MAGIC: Final = b"SWCTRL01"
_FACTS: Final = struct.Struct("<8sII32s32s32s32sI44s64s64s96s")
_VEHICLE: Final = struct.Struct("<Q3ddI")
_SIGNED: Final = 448
_UNSIGNED: Final = bytes(96)
LINE: Final = 32
"""Number of data bytes in a line. Every tool accepts 32. 32 divides 64 KiB, so no line crosses a multiple of 64 KiB."""
HIGH: Final = 1 << 16
"""Number of addresses that a data line of Intel HEX can state; a line of another type states the upper 16 bits."""


@dataclass(frozen=True, kw_only=True)
class ImageFacts:
    """The data of an image's header, in the units of the module's table. A `hardware` of None permits any hardware."""

    layout: bytes
    dbc: bytes
    digest: bytes
    security_version: int
    period_ns: int
    operating_point: tuple[float, float, float]
    action_limit: float
    sensors: int
    hardware: str | None
    name: str

    @property
    def vehicle(self) -> bytes:
        """The header's bytes at the position `VEHICLE`."""
        return _VEHICLE.pack(self.period_ns, *self.operating_point, self.action_limit, self.sensors)


@dataclass(frozen=True, kw_only=True, eq=False)
class ControllerImage:
    """A verified image. `signer` is the key that signed the image; None if the image is unsigned."""

    facts: ImageFacts
    payload: bytes
    signer: PublicKey | None

    @property
    def digest(self) -> str:
        return self.facts.digest.hex()

    @property
    def name(self) -> str:
        return self.facts.name

    @property
    def security_version(self) -> int:
        return self.facts.security_version


def seal(payload: bytes, facts: ImageFacts, key: Ed25519PrivateKey | None) -> bytes:
    """Build the image of a payload, and sign it if a key is given. Raises BundleContainerError for a bad name."""
    header = _FACTS.pack(
        _MAGIC,
        HEADER_BYTES + len(payload),
        HEADER_BYTES,
        hashlib.sha256(payload).digest(),
        facts.layout,
        facts.dbc,
        facts.digest,
        facts.security_version,
        facts.vehicle,
        b"" if facts.hardware is None else name_bytes("hardware", facts.hardware),
        name_bytes("name", facts.name),
        b"",
    )
    if key is None:
        return header + _UNSIGNED + payload
    header += signing.public_key(key).raw
    return header + key.sign(header) + payload


def signer_of(image: bytes) -> PublicKey | None:
    """Verify an image's signature and return the signer's key; None if the image is unsigned. Nothing else is checked.
    Raises BundleContainerError for bytes that are no complete image, BundleSignatureError for a bad signature."""
    if len(image) < HEADER_BYTES:
        raise BundleContainerError(f"the image has {len(image)} bytes: must have {HEADER_BYTES} or more")
    magic, length, header = struct.unpack_from("<8sII", image)
    if magic != _MAGIC:
        raise BundleContainerError(f"image begins with {magic.hex()}: must begin with {_MAGIC.hex()}")
    if (length, header) != (len(image), HEADER_BYTES):
        raise BundleContainerError(
            f"the image has {len(image)} bytes, but states a length of {length}; the stated header has "
            f"{header} bytes: must have {HEADER_BYTES}"
        )
    if image[_FACTS.size : HEADER_BYTES] == _UNSIGNED:
        return None
    key, signature = image[_FACTS.size : _SIGNED], image[_SIGNED:HEADER_BYTES]
    if not signing.is_good(signature, key, image[:_SIGNED]):
        raise BundleSignatureError("image: bad signature: its header was altered")
    return PublicKey(key)


def read(image: bytes) -> ControllerImage:
    """Read and check an image, signed by any key or by none. Raises as `signer_of` does, and for a damaged image."""
    signer, payload = signer_of(image), image[HEADER_BYTES:]
    _, _, _, sha256, layout, dbc, digest, version, vehicle, hardware, name, reserved = _FACTS.unpack_from(image)
    period, width, speed, density, limit, sensors = _VEHICLE.unpack(vehicle)
    if sha256 != hashlib.sha256(payload).digest():
        raise BundleContainerError("image: its payload was altered (SHA-256 does not match the header)")
    if any(reserved):
        raise BundleContainerError("image: bytes 320..415 must be zeros; a newer version may have made the image")
    facts = ImageFacts(
        layout=layout,
        dbc=dbc,
        digest=digest,
        security_version=version,
        period_ns=period,
        operating_point=(width, speed, density),
        action_limit=limit,
        sensors=sensors,
        hardware=_unpacked("hardware", hardware) if any(hardware) else None,
        name=_unpacked("name", name),
    )
    return ControllerImage(facts=facts, payload=payload, signer=signer)


def name_bytes(what: str, text: str) -> bytes:
    """Return a name as the header stores it. Raises BundleContainerError for a name that the header cannot store."""
    raw = text.encode(errors="surrogatepass")
    if not _is_name(raw):
        raise BundleContainerError(f"image: {what} {quoted(text)}: must be 1 to {_MAX_NAME} printable ASCII characters")
    return raw


def _unpacked(what: str, field: bytes) -> str:
    raw = field.rstrip(b"\0")
    if not _is_name(raw):
        raise BundleContainerError(f"image: {what} {field.hex()}: must be printable ASCII, padded with zeros")
    return raw.decode()


def _is_name(raw: bytes) -> bool:
    return 0 < len(raw) <= _MAX_NAME and all(0x20 <= byte < 0x7F for byte in raw)


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
