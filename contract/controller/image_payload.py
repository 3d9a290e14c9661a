"""The payload of an image for a microcontroller: a release's parameters as C reads them, then a text with their layout.

The parameters have the form of `sw_payload` in `sw_image.h`. The text is the layout; C does not read it. It has a line
for each setting and struct on which the positions or the meaning of the parameters depend. The text's SHA-256
identifies the layout, in the image's header and in a build's `sw_layout.h`. A build refuses parameters of another
layout. The library's headers state only one more fact about a release: the identity of the compiled-in release.

An ECU must not use an invalid number as an index or a bound. The bounds of single numbers are stated in this module
only. A build's `sw_layout.h` has a table of these bounds, with which `sw_image_open` checks an image in C;
`check_numbers` checks an image in Python. Floating-point numbers must be finite. Divisors and widths must be positive.
Integers must be so small that no sum of the int8 library overflows. Rules for several numbers together are stated
twice, in C and in `wrong_in`.
"""

import hashlib
from collections.abc import Iterator, Mapping
from itertools import pairwise
from math import prod
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from contract.controller.c_folder import ECU_SETTINGS, ProgramSettings, generated_header
from contract.errors import BundleContainerError

LAYOUT: Final = "sw_layout.h"
"""Name of the header that is generated from the other generated headers."""
RELEASE_PART: Final = "sw_release.bin"
WEIGHTS_PART: Final = "sw_weights.bin"
ESTIMATOR_PART: Final = "sw_estimator_weights.bin"
"""Name of the estimator's part of the payload, which exists only with a sensor check. The other parts always exist."""
_OF_ECU: Final = ("SW_RELEASE_LAYOUT", "SW_RELEASE_BYTES", "SW_PAST", "SW_SENSOR_CHECK")
"""Settings of `sw_ecu_settings.h` on which the parameters depend; the other settings describe the vehicle."""
_TITLE: Final = "layout 2 of a stillwake controller image\n"
"""First line of a layout. The number in the line rises if a member gets another meaning but has the same size. In
layout 1, the wake without jets was relative to the wake at the design speed."""
LEAST_FIGURE: Final = 1e-9
MOST_FIGURE: Final = 1e3
"""Largest permitted magnitude, in Cp, of the figures that describe the residuals of healthy sensors and the wake
without jets; `LEAST_FIGURE` is the smallest magnitude. These figures or their squares are divisors."""
MOST_WEIGHT: Final = 1e6
"""Largest permitted magnitude of a weight of the estimate of the air speed."""
_TYPES: Final = ("int8", "uint8", "int32", "float32", "float64")
"""Types of arrays. `sw_image.c` numbers the types in this order."""
_POSITIVE: Final = frozenset(
    {
        *("design_speed", "design_density", "window_factor", "force_std", "action_limit", "action_factor", "factor"),
        *("adam_rate", "adam_unbias", "adam_epsilon", "spread"),
        *("row_inverse_scale", "head_inverse_scale", "state_inverse_scale", "decoder_inverse_scale"),
    }
)
_NOT_NEGATIVE: Final = frozenset({"weights", "default_weights", "slowest", "decoder_largest"})
Member = tuple[str, tuple[int, ...], int]
"""Type and shape of an array, and its offset in the payload, in bytes."""
Range = tuple[float, float]


class Limits(NamedTuple):
    """The bounds of some numbers in a payload. The numbers form `groups` groups of `run` consecutive numbers. The first
    group begins at byte `place`, and each further group begins `stride` bytes after the group before."""

    name: str
    dtype: str
    place: int
    run: int
    groups: int
    stride: int
    least: float
    most: float

    @property
    def in_c(self) -> str:
        """The C initialiser of an `sw_limits` with these bounds."""
        numbers = (*self[2:6], _TYPES.index(self.dtype))
        return f"{{{', '.join(f'{number}u' for number in numbers)}, {self.least!r}, {self.most!r}}}"


def limits_in(members: Mapping[str, Member], layout: Mapping[str, str]) -> Iterator[Limits]:
    """Yield the limits of each array of a layout; `members` has the arrays by name, such as "weights.window_mean"."""
    for name, (dtype, sides, place) in members.items():
        struct, _, member = name.partition(".")
        each = _ranges(struct, member, dtype, layout)
        if not each:
            continue
        # An array may hold several constants per output. If its last axis has one entry per constant, the constants
        # alternate in memory. Otherwise the last axis has the values of one constant for eight outputs.
        run = 1 if sides[-1] == len(each) else sides[-1]
        count, size = prod(sides), np.dtype(dtype).itemsize
        if len(each) == 1:
            yield Limits(name, dtype, place, count, 1, 0, *each[0])
            continue
        for number, limits in enumerate(each):
            groups, stride = count // (run * len(each)), len(each) * run * size
            yield Limits(name, dtype, place + number * run * size, run, groups, stride, *limits)


def wrong_in(payload: bytes, layout: Mapping[str, str]) -> Iterator[str]:
    """Describe the numbers that are outside their limits, then numbers that contradict each other."""
    for one in limits_in(members_in(layout), layout):
        dtype = np.dtype(one.dtype).newbyteorder("<")
        for group in range(one.groups):
            values = np.frombuffer(payload, dtype, one.run, one.place + group * one.stride)
            wrong = values[~((values >= one.least) & (values <= one.most))]
            if wrong.size:
                yield f"{one.name} holds {wrong[0]:g}: must be in {one.least:g}..{one.most:g}"
    # `sw_image.c` states these rules a second time.
    arrays = arrays_in(payload, layout)
    rows = arrays.get("weights.prior_filter_rows")
    if rows is not None:
        memory, all_rows = (_stated(layout, f"SW_PRIOR_{name}", 1) for name in ("MEMORY", "FILTER_ROWS"))
        if (rows.sum(axis=1) > memory).any() or rows[:, 1].sum() != all_rows:
            yield f"weights.prior_filter_rows: filters must end within {memory} rows and have {all_rows} rows together"
    speeds = arrays.get("release.resting", np.zeros((0, 3)))[:, 0]
    if any(after <= before for before, after in pairwise(speeds)):
        yield "release.resting: its speeds must increase"
    past, window = _stated(layout, "SW_PAST", 0), _stated(layout, "SW_WINDOW", 0)
    for slowest in arrays.get("release.slowest", np.zeros(0)) if past else ():
        if window / slowest > (past if slowest >= 1.0 else past - 1):
            yield f"release.slowest is {slowest:g}: a past of {past} rows is too short for a window of {window}"


def _ranges(struct: str, member: str, dtype: str, layout: Mapping[str, str]) -> tuple[Range, ...]:
    """Return the allowed range of each constant that an array holds; an empty tuple if any number is allowed."""
    if dtype.startswith("float"):
        info: Any = np.finfo(dtype)
        return _of_floats(struct, member, layout, float(info.tiny), float(info.max))
    if dtype == "int8":
        return ((-127.0, 127.0),)  # a sum of products with -128 may overflow
    if member in ("base", "pairs"):
        return ((0.0, _stated(layout, "SW_SENSORS", 256) - 1.0),)
    if member == "prior_filter_rows":
        memory = float(_stated(layout, "SW_PRIOR_MEMORY", 1))
        return (0.0, memory - 1.0), (1.0, memory)
    if member.endswith("_adjoint"):  # gain and scale of the rows; `export.to_c.int8_arrays` has the same bounds
        return (-(2.0**22), 2.0**22), (0.0, 2.0**23)
    return ((0.0, 65535.0),) if member == "residual_of_elu" else ()


def _of_floats(struct: str, member: str, layout: Mapping[str, str], positive: float, most: float) -> tuple[Range, ...]:
    if member == "air_speed":
        return ((-MOST_WEIGHT, MOST_WEIGHT),)
    if member == "resting":
        return (positive, most), (-MOST_FIGURE, -LEAST_FIGURE), (LEAST_FIGURE, MOST_FIGURE)
    if member in ("slowest", "fastest") and _stated(layout, "SW_PAST", 0):
        return ((0.1, 1.0) if member == "slowest" else (1.0, 10.0),)
    if member.endswith("_layer"):
        return (positive, most), (0.0, most)
    if member == "cell_inverse_scale":
        return ((positive, _widest_integer(layout)),)
    if struct == "estimator" and member != "factor":
        most = 2.0**17  # with such weights every estimate is finite
    if member.endswith("_deviation"):
        return ((LEAST_FIGURE if _stated(layout, "SW_SENSOR_CHECK", 0) else 0.0, MOST_FIGURE),)
    return ((positive if member in _POSITIVE else 0.0 if member in _NOT_NEGATIVE else -most, most),)


def _widest_integer(layout: Mapping[str, str]) -> float:
    """Return the largest integer of the LSTM's hidden state, `SW_QMAX` in C. No rounded value saturates."""
    lanes, most = _stated(layout, "SW_LANES", 8), _stated(layout, "SW_INT16_QMAX", 32767)
    padded = -(-_stated(layout, "SW_LSTM", 1) // lanes) * lanes
    is_full = padded <= _stated(layout, "SW_FULL_RANGE_WIDTH", padded)
    return float(most if is_full else _stated(layout, "SW_SUM_QMAX", padded) // padded)


def _stated(layout: Mapping[str, str], name: str, otherwise: int) -> int:
    return int(layout.get(name, otherwise))


def layout_of(files: Mapping[str, bytes]) -> str:
    """Return the layout of a library with an ECU from its files by name, without the compiled-in program's hash."""
    ecu = ProgramSettings(files[ECU_SETTINGS]).definitions
    found = ProgramSettings.of(files).definitions | {name: ecu[name] for name in _OF_ECU}
    if ecu["SW_SENSOR_CHECK"] != "0":
        found |= ProgramSettings(files["sw_estimator_settings.h"]).definitions
    return _TITLE + "".join(f"{name} {found[name]}\n" for name in sorted(found) if name != "SW_PROGRAM_SHA256")


def with_layout(files: Mapping[str, bytes]) -> dict[str, bytes]:
    """Return the files of a library. If the library has an ECU, `sw_layout.h` is added."""
    if ECU_SETTINGS not in files:
        return dict(files)
    definitions = _definitions(layout := layout_of(files))
    digest = ", ".join(f"0x{byte:02x}" for byte in sha256_of(layout))
    table = ", ".join(limits.in_c for limits in limits_in(members_in(definitions), definitions))
    values = {"SW_LAYOUT_SHA256": f"{{{digest}}}", "SW_LIMITS": f"{{{table}}}"}
    what = "the SHA-256 of this build's layout of a release's numbers, and the numbers' limits"
    return {**files, LAYOUT: generated_header(LAYOUT, what, values)}


def sha256_of(layout: str) -> bytes:
    """Return the SHA-256 that identifies a layout."""
    return hashlib.sha256(layout.encode()).digest()


def payload_of(files: Mapping[str, bytes]) -> bytes:
    """Return the payload of a library's release: the contents of its binary parts, then the layout."""
    alignment, content = ProgramSettings.of(files).number("SW_ALIGNMENT"), b""
    for name in (RELEASE_PART, WEIGHTS_PART, ESTIMATOR_PART):
        content += files.get(name, b"")
        content += bytes(-len(content) % alignment)
    return content + layout_of(files).encode()


def layout_in(payload: bytes, sha256: bytes) -> dict[str, str]:
    """Return a payload's layout definitions. Raises BundleContainerError if the layout's SHA-256 is not `sha256`."""
    start = payload.rfind(_TITLE.encode())
    if start < 0 or hashlib.sha256(payload[start:]).digest() != sha256:
        raise BundleContainerError(f"image: its layout text (SHA-256 {sha256.hex()[:12]}..) is missing or altered")
    return _definitions(payload[start:].decode())


def check_numbers(payload: bytes, sha256: bytes) -> None:
    """Raise BundleContainerError if a payload is too short, or its layout or a number is invalid."""
    try:
        layout = layout_in(payload, sha256)
        if _starts(layout)[""] > payload.rfind(_TITLE.encode()):
            raise BundleContainerError(f"image: a payload of {len(payload)} bytes is too short for its layout")
        for wrong in wrong_in(payload, layout):
            raise BundleContainerError(f"image: {wrong}")
    except (ArithmeticError, LookupError, TypeError, ValueError) as error:
        raise BundleContainerError(f"image: its layout text (SHA-256 {sha256.hex()[:12]}..) is damaged") from error


def arrays_in(payload: bytes, layout: Mapping[str, str]) -> dict[str, npt.NDArray[Any]]:
    """Return every array of a payload by the names of struct and array, such as "weights.window_mean"."""
    return {
        name: np.frombuffer(payload, np.dtype(kind).newbyteorder("<"), prod(sides), place).reshape(sides)
        for name, (kind, sides, place) in members_in(layout).items()
    }


def _definitions(layout: str) -> dict[str, str]:
    return dict(line.split(" ", 1) for line in layout.splitlines()[1:])


def _starts(layout: Mapping[str, str]) -> dict[str, int]:
    """Return the offset of each struct of a payload by its name; the name "" has the offset of the payload's end."""
    found, start = {}, 0
    for struct in ("SW_RELEASE", "SW_WEIGHTS", "SW_HOT", "SW_ESTIMATOR", ""):
        found[struct] = start
        start += int(layout.get(f"{struct}_BYTES", 0))
        start += -start % int(layout["SW_ALIGNMENT"])
    return found


def members_in(layout: Mapping[str, str]) -> dict[str, Member]:
    """Return type, shape and offset of every array, by names such as "weights.window_mean"."""
    found = {}
    for struct, start in _starts(layout).items():
        for member in filter(None, layout.get(f"{struct}_LAYOUT", "").strip('"').split("; ")):
            name, kind, sides, place = member.split(" ")
            whole = f"{struct.removeprefix('SW_').lower()}.{name}"
            found[whole] = kind, tuple(map(int, sides.split("x"))), start + int(place)
    return found
