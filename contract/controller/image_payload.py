"""What an image for a microcontroller has behind its header: a release's numbers as C reads them, then what they are.

`sw_payload` of `sw_image.h`, and a text that C does not read: the layout, a line for every setting and every struct on
which the places of the numbers depend, or their meaning. Its SHA-256 names the layout in the image's header and in
`sw_layout.h` of a build; numbers of another layout are not for that build. A library's headers have nothing else that
belongs to a release, but for what identifies the one that is compiled in.
"""

import hashlib
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from contract.controller.c_folder import ECU_SETTINGS, Settings
from contract.controller.image_limits import Member, limits_in, wrong_in
from contract.errors import BundleContainerError

LAYOUT: Final = "sw_layout.h"
"""Generated from the other generated headers."""
RELEASE: Final = "sw_release.bin"
WEIGHTS: Final = "sw_weights.bin"
ESTIMATOR: Final = "sw_estimator_weights.bin"
"""Parts of a payload; the last one where there is a sensor check."""
_ESTIMATOR_SETTINGS: Final = "sw_estimator_settings.h"
_IDENTITY: Final = "SW_PROGRAM_SHA256"
"""What `sw_settings.h` has of the program that is compiled in."""
_OF_ECU: Final = ("SW_RELEASE_LAYOUT", "SW_RELEASE_BYTES", "SW_PAST", "SW_SENSOR_CHECK")
"""Settings of `sw_ecu_settings.h` that the numbers depend on; the others are the vehicle's."""
_TITLE: Final = "layout 2 of a stillwake controller image\n"
"""Its number rises when a member's meaning changes and its size does not: in the first, the wake without jets was in
shares of the design speed's."""
_STRUCTS: Final = ("SW_RELEASE", "SW_WEIGHTS", "SW_HOT", "SW_ESTIMATOR")
"""Of a payload, in its order."""


def layout_of(files: Mapping[str, bytes]) -> str:
    """The layout of a library with its ECU, by the names of its files."""
    ecu = Settings(files[ECU_SETTINGS]).definitions
    found = Settings.of(files).definitions | {name: ecu[name] for name in _OF_ECU}
    if ecu["SW_SENSOR_CHECK"] != "0":
        found |= Settings(files[_ESTIMATOR_SETTINGS]).definitions
    return _TITLE + "".join(f"{name} {found[name]}\n" for name in sorted(found) if name != _IDENTITY)


def with_layout(files: Mapping[str, bytes]) -> dict[str, bytes]:
    """The files of a library, with `sw_layout.h` where there is an ECU."""
    if ECU_SETTINGS not in files:
        return dict(files)
    layout = layout_of(files)
    digest = ", ".join(f"0x{byte:02x}" for byte in sha256_of(layout))
    definitions = _definitions(layout)
    table = ", ".join(limits.in_c for limits in limits_in(members_in(definitions), definitions))
    text = (
        "/* Generated: the name of this build's layout of a release's numbers, and what they may be. */\n"
        "#ifndef SW_LAYOUT_H\n#define SW_LAYOUT_H\n\n"
        f"#define SW_LAYOUT_SHA256 {{{digest}}}\n#define SW_LIMITS {{{table}}}\n\n#endif\n"
    )
    return {**files, LAYOUT: text.encode()}


def sha256_of(layout: str) -> bytes:
    """The name of a layout."""
    return hashlib.sha256(layout.encode()).digest()


def payload_of(files: Mapping[str, bytes]) -> bytes:
    """The payload of a library's release: `sw_release.bin`, and what else the folder has of it."""
    alignment, content = Settings.of(files).number("SW_ALIGNMENT"), b""
    for name in (RELEASE, WEIGHTS, ESTIMATOR):
        content += files.get(name, b"")
        content += bytes(-len(content) % alignment)
    return content + layout_of(files).encode()


def layout_in(payload: bytes, sha256: bytes) -> dict[str, str]:
    """The definitions of a payload's layout; raises BundleContainerError if it has none of this name."""
    start = payload.rfind(_TITLE.encode())
    if start < 0 or hashlib.sha256(payload[start:]).digest() != sha256:
        raise BundleContainerError(f"image: no text of its layout {sha256.hex()[:12]} behind its numbers")
    return _definitions(payload[start:].decode())


def check_numbers(payload: bytes, sha256: bytes) -> None:
    """Raise BundleContainerError for a payload that no ECU of the layout of this name opens: one that is too short, or
    has a number that is no index or no bound (`contract.controller.image_limits`)."""
    layout = layout_in(payload, sha256)
    if _starts(layout)[""] > payload.rfind(_TITLE.encode()):
        raise BundleContainerError(f"image: a payload of {len(payload)} bytes is too short for its layout")
    wrong = wrong_in(payload, members_in(layout), arrays_in(payload, layout), layout)
    if wrong is not None:
        raise BundleContainerError(f"image: {wrong}")


def arrays_in(payload: bytes, layout: Mapping[str, str]) -> dict[str, npt.NDArray[Any]]:
    """Every array of a payload by the names of its struct and of itself, such as "weights.window_mean"."""
    found = {}
    for name, (kind, sides, place) in members_in(layout).items():
        values = np.frombuffer(payload, np.dtype(kind).newbyteorder("<"), int(np.prod(sides)), place)
        found[name] = values.reshape(sides)
    return found


def _definitions(layout: str) -> dict[str, str]:
    return dict(line.split(" ", 1) for line in layout.splitlines()[1:])


def _starts(layout: Mapping[str, str]) -> dict[str, int]:
    """Where each struct of a payload begins, and the next one would."""
    found, start = {}, 0
    for struct in (*_STRUCTS, ""):
        found[struct] = start
        start += int(layout.get(f"{struct}_BYTES", 0))
        start += -start % int(layout["SW_ALIGNMENT"])
    return found


def members_in(layout: Mapping[str, str]) -> dict[str, Member]:
    """Every array by the names of its struct and of itself."""
    found = {}
    for struct, start in _starts(layout).items():
        for member in filter(None, layout.get(f"{struct}_LAYOUT", "").strip('"').split("; ")):
            name, kind, sides, place = member.split(" ")
            whole = f"{struct.removeprefix('SW_').lower()}.{name}"
            found[whole] = kind, tuple(map(int, sides.split("x"))), start + int(place)
    return found
