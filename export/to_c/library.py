"""The C99 library of one control step: hand-written sources from `sources/`, generated settings and weights.

The generated text is numbers only. `sw_settings.h` has the sizes, the settings, and the hashes of the program and of
the DBC it was built beside; `sw_weights.c` has the arrays that `sw_weights.h` declares.
"""

from collections.abc import Callable, Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any, Final, overload

import numpy as np

from contract.atomic import replacing
from contract.errors import ExportError
from contract.release.bundle import dbc_sha256
from contract.release.manifest import Precision
from export.int8.activation_ranges import ActivationRanges
from export.int8.rounded_program import Program, RoundedProgram, effective, precision_of
from export.program.controller_program import ControllerProgram
from export.program.float32 import as_float32, float32_within
from export.program.program_hash import program_sha256
from export.to_c.float32_arrays import LANES, float_arrays
from export.to_c.int8_arrays import Values, int8_arrays

SETTINGS: Final = "sw_settings.h"
WEIGHTS: Final = "sw_weights.c"

_LINE: Final = 16


@overload
def c_library(program: ControllerProgram) -> dict[str, bytes]: ...


@overload
def c_library(program: RoundedProgram, ranges: ActivationRanges) -> dict[str, bytes]: ...


def c_library(program: Program, ranges: ActivationRanges | None = None) -> dict[str, bytes]:
    """All files of the library by name: in float32, or of a rounded program with integer products.

    Args:
        ranges: of the activations of a rounded program.

    Raises:
        ExportError: a value that float32 cannot hold, or a program that the library cannot run; the message names it.
    """
    if isinstance(program, RoundedProgram):
        assert ranges is not None
        arrays = int8_arrays(program, ranges)
    else:
        arrays = {**float_arrays(program)}
    precision = precision_of(program)
    return hand_written(precision) | {
        SETTINGS: _settings(effective(program), precision).encode(),
        WEIGHTS: _weights(arrays).encode(),
    }


def hand_written(precision: Precision) -> dict[str, bytes]:
    """The sources that are the same for every program."""
    root = files("export.to_c").joinpath("sources")
    return {
        item.name: item.read_bytes()
        for folder in ("common", precision)
        for item in root.joinpath(folder).iterdir()
        if item.name.endswith((".c", ".h"))
    }


def write_c_library(folder: Path, contents: Mapping[str, bytes]) -> None:
    """Write the library's folder, whole or not at all.

    Raises:
        ExportError: the folder holds something else.
        StillwakeError: it cannot be written.
    """
    if folder.is_dir() and any(folder.iterdir()) and not (folder / SETTINGS).is_file():
        # Writing replaces the whole folder.
        raise ExportError(f"{folder}: that directory holds something else; name another")
    with replacing(folder) as temporary:
        temporary.mkdir()
        for name, content in contents.items():
            (temporary / name).write_bytes(content)


def _settings(program: ControllerProgram, precision: Precision) -> str:
    mpc = program.mpc
    numbers: dict[str, int | str] = {
        "SW_PROGRAM_SHA256": f'"{program_sha256(program)}"',
        "SW_DBC_SHA256": f'"{dbc_sha256()}"',
        "SW_SENSOR_NAMES": f'"{" ".join(program.sensors)}"',
        "SW_PRECISION": f'"{precision}"',
        **({"SW_LANES": LANES} if precision == "float32" else {}),
        "SW_WINDOW": program.window,
        "SW_SENSORS": len(program.sensors),
        "SW_LSTM": program.encoder.lstm.width,
        "SW_HEAD": len(program.encoder.hidden.bias),
        "SW_LATENT": program.latent,
        "SW_DYN1": len(program.dynamics.input.bias),
        "SW_DYN2": len(program.dynamics.hidden.bias),
        "SW_DECODER": len(program.decoder.input.bias),
        "SW_BLOCKS": len(program.decoder.blocks),
        "SW_HORIZON": mpc.horizon,
        "SW_ITERATIONS": mpc.iterations,
        "SW_DRAG_REFERENCE": _number(np.float32(as_float32(mpc.drag_reference, "mpc.drag_reference"))),
        "SW_ACTION_LIMIT": _number(np.float32(float32_within(program.action_limit))),
    }
    lines = "\n".join(f"#define {name} {value}" for name, value in numbers.items())
    return f"/* Generated: sizes and settings of one trained program. */\n{_guarded('SW_SETTINGS_H', lines)}"


def _weights(arrays: Mapping[str, Values]) -> str:
    text = ["/* Generated: the numbers of one trained program. */", '#include "sw_weights.h"']
    for name, values in arrays.items():
        sides = "".join(f"[{size}]" for size in values.shape)
        if values.dtype in (np.int8, np.uint32):
            text.append(f"const {values.dtype}_t SW_ALIGNED {name}{sides} = {_initialiser(values, str)};")
        else:
            text.append(f"const float SW_ALIGNED {name}{sides} = {_initialiser(as_float32(values, name), _number)};")
    return "\n\n".join(text) + "\n"


def _initialiser(values: Any, number: Callable[[Any], str]) -> str:
    if values.ndim == 0:
        return number(values[()])
    if values.ndim > 1:
        return "{\n" + ",\n".join(_initialiser(part, number) for part in values) + "}"
    lines = (values[start : start + _LINE] for start in range(0, len(values), _LINE))
    return "{" + ",\n ".join(", ".join(map(number, line)) for line in lines) + "}"


def _number(value: np.float32) -> str:
    """The shortest decimal that is this float32 again."""
    text = np.format_float_scientific(value, trim="0")
    return f"{text}f"


def _guarded(name: str, body: str) -> str:
    return f"#ifndef {name}\n#define {name}\n\n{body}\n\n#endif\n"
