"""The C99 library of one control step, and the ECU around it: hand-written sources, generated settings and weights.

The generated text is numbers only: `sw_settings.h` and `sw_weights.c` (`contract.controller.c_folder`).
"""

from collections.abc import Callable, Mapping
from importlib.resources import files
from typing import Any, Final, overload

import numpy as np

from contract.controller.c_folder import SETTINGS, WEIGHTS, float_literal, settings_header
from contract.controller.interface import TERMS
from contract.release.checks import dbc_sha256
from contract.release.manifest import Precision
from export.int8.activation_ranges import ActivationRanges
from export.int8.rounded_program import Program, RoundedProgram, effective, precision_of
from export.program.controller_program import ControllerProgram
from export.program.float32 import as_float32, float32_within
from export.program.program_hash import program_sha256
from export.program.weights import LAYER_NORM_EPSILON
from export.reference.mpc import ADAM_BETAS
from export.reference.specification import AnyProgram
from export.to_c.float32_arrays import LANES, Values, float_arrays, prior_settings
from export.to_c.int8_arrays import int8_arrays
from export.to_c.int8_format import c_constants

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
    return static_sources(precision) | {
        SETTINGS: settings_header(settings(effective(program), precision)),
        WEIGHTS: numbers_source(arrays, "the numbers of one trained program", "sw_weights.h"),
    }


def static_sources(precision: Precision) -> dict[str, bytes]:
    """The control step's sources that are the same for every program."""
    return _sources_in("common", "networks", precision)


def linear_sources() -> dict[str, bytes]:
    """The same of a linear controller."""
    return _sources_in("common", "linear")


def ecu_sources() -> dict[str, bytes]:
    """The sources of the ECU around a control step, the same for every program and vehicle.

    What is generated for one of each is not among them: `sw_ecu_settings.h` (`firmware_sim.in_c.c_settings`).
    """
    return _sources_in("ecu")


def _sources_in(*folders: str) -> dict[str, bytes]:
    root = files("export.to_c").joinpath("sources")
    return {
        item.name: item.read_bytes()
        for folder in folders
        for item in root.joinpath(folder).iterdir()
        if item.name.endswith((".c", ".h"))
    }


def settings(program: ControllerProgram, precision: Precision) -> dict[str, int | str | np.float32]:
    """Everything of `sw_settings.h`: numbers that C shares with Python stand here, and nowhere in C."""
    mpc = program.mpc
    beta1, beta2 = ADAM_BETAS
    return {
        **shared_settings(program, precision),
        "SW_LSTM": program.encoder.lstm.width,
        "SW_HEAD": len(program.encoder.hidden.bias),
        "SW_LATENT": program.latent,
        "SW_DYN1": len(program.dynamics.input.bias),
        "SW_DYN2": len(program.dynamics.hidden.bias),
        "SW_DECODER": len(program.decoder.input.bias),
        "SW_BLOCKS": len(program.decoder.blocks),
        "SW_ITERATIONS": mpc.iterations,
        "SW_NORM_EPSILON": np.float32(LAYER_NORM_EPSILON),
        "SW_ADAM_BETA1": np.float32(beta1),
        "SW_ADAM_BETA2": np.float32(beta2),
        "SW_ADAM_EPSILON": np.float32(as_float32(mpc.epsilon, "mpc.epsilon")),
        "SW_ENCODER_ROWS": program.encoder_rows,
        "SW_PRIOR_UNITS": 0 if program.prior is None else len(program.prior.output),
        "SW_PRIOR_MEMORY": 1 if program.prior is None else program.prior.memory,
        **({} if program.prior is None else prior_settings(program.prior)),
        **({"SW_LANES": LANES} if precision == "float32" else c_constants()),
    }


def shared_settings(program: AnyProgram, precision: Precision) -> dict[str, int | str | np.float32]:
    """What `sw_settings.h` has of either kind of program."""
    mpc = program.mpc
    return {
        "SW_PROGRAM_SHA256": program_sha256(program),
        "SW_DBC_SHA256": dbc_sha256(),
        "SW_SENSOR_NAMES": " ".join(program.sensors),
        "SW_PRECISION": precision,
        "SW_WINDOW": program.window,
        "SW_SENSORS": len(program.sensors),
        "SW_HORIZON": mpc.horizon,
        "SW_DRAG_REFERENCE": np.float32(as_float32(mpc.drag_reference, "mpc.drag_reference")),
        "SW_ACTION_LIMIT": np.float32(float32_within(program.action_limit)),
        # In C, `SW_` and a term's name in capitals is its index.
        **{f"SW_{name.upper()}": index for index, name in enumerate(TERMS)},
        "SW_TERMS": len(TERMS),
    }


def numbers_source(arrays: Mapping[str, Values], what: str, header: str) -> bytes:
    """A source file that defines the arrays by name, as the header declares them."""
    text = [f"/* Generated: {what}. */", f'#include "{header}"']
    for name, values in arrays.items():
        sides = "".join(f"[{size}]" for size in values.shape)
        if values.dtype in (np.int8, np.int32, np.uint32):
            text.append(f"const {values.dtype}_t SW_ALIGNED {name}{sides} = {_initialiser(values, str)};")
        else:
            text.append(
                f"const float SW_ALIGNED {name}{sides} = {_initialiser(as_float32(values, name), float_literal)};"
            )
    return ("\n\n".join(text) + "\n").encode()


def _initialiser(values: Any, number: Callable[[Any], str]) -> str:
    if values.ndim == 0:
        return number(values[()])
    if values.ndim > 1:
        return "{\n" + ",\n".join(_initialiser(part, number) for part in values) + "}"
    lines = (values[start : start + _LINE] for start in range(0, len(values), _LINE))
    return "{" + ",\n ".join(", ".join(map(number, line)) for line in lines) + "}"


def example_sources() -> dict[str, bytes]:
    """Programs with a `main` of their own around the ECU, by their names in a folder.

    What one of them plays is generated: `examples/pressures.h` (`firmware_sim.in_c.c_examples`).
    """
    root = files("export.to_c").joinpath("sources/examples")
    return {f"examples/{item.name}": item.read_bytes() for item in root.iterdir() if item.name.endswith((".c", ".ld"))}
