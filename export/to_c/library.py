"""The C99 library of one control step (`contract.controller.c_folder`): hand-written sources, and the generated
settings and weights. The library's folder also has documents and the expected answers of an example program."""

from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from contract.arrays import Array
from contract.controller import c_folder, image_payload
from contract.controller.c_folder import DOCUMENTS, PROGRAM_SETTINGS, PROGRAM_WEIGHTS, Numbers, ProgramSettings
from contract.controller.interface import FORCES, TERMS, Controller
from contract.release.checks import dbc_sha256
from contract.release.manifest import WeightPrecision
from export.int8 import Program, RoundedProgram, activation_ranges, effective, precision_of, rounded_on
from export.program.controller_program import ControllerProgram, program_sha256
from export.program.weights import LAYER_NORM_EPSILON, as_float32
from export.reference.mpc import ADAM_BETAS
from export.to_c.float32_arrays import FLOAT32_LANES, ArrayValues, float_arrays, prior_settings
from export.to_c.int8_arrays import c_constants, int8_arrays

ALIGNMENTS: Final = {"int8": 16, "float32": 64}
"""Alignment of the arrays in bytes: 16 suffices for int8 on Cortex-M and in vector registers; 64 is a cache line."""
_TABLES: Final = ("sw_elu_points", "sw_logistic_points")
"""Tables that are equal for every program. They are compiled into the library and are not part of a release."""
_HOT: Final = ("sw_dyn1_rows", "sw_dyn1_adjoint_rows", "sw_dyn2_rows", "sw_dyn2_adjoint_rows", "sw_dyn3_rows",
               "sw_dyn3_adjoint_rows")  # fmt: skip
"""Names of the arrays in the C struct `sw_hot`."""


def int8_library(program: ControllerProgram, calibration: Sequence[Array]) -> dict[str, bytes]:
    """Round a program's weights with recorded windows (L, S+1), and return the int8 C library."""
    return c_library(rounded_on(program, calibration), calibration)


def c_library(program: Program, calibration: Sequence[Array] = ()) -> dict[str, bytes]:
    """Return all files of the library by name. The library computes in float32 or, for a rounded program, with integer
    products. `calibration` has the recorded windows (L, S+1) with which a program was rounded; they give the ranges of
    activations. Raises ExportError for a value that float32 cannot hold, or a program that C cannot compute."""
    if isinstance(program, RoundedProgram):
        arrays = int8_arrays(program, activation_ranges(program.program, calibration))
    else:
        arrays = {**float_arrays(program)}
    precision = precision_of(program)
    alignment = ALIGNMENTS[precision]
    rest = {name: values for name, values in arrays.items() if name not in (*_HOT, *_TABLES)}
    hot: dict[str, ArrayValues] = {name: arrays[name] for name in _HOT if name in arrays}
    constants = {"sw_own_weights": numbers("sw_weights", rest, alignment)}
    sizes = constants["sw_own_weights"].settings("SW_WEIGHTS") | {"SW_HOT_BYTES": 0}
    if hot:
        constants["sw_own_hot"] = numbers("sw_hot", hot, alignment)
        sizes |= constants["sw_own_hot"].settings("SW_HOT")
    tables = "\n\n".join(c_folder.table(name, arrays[name]) for name in _TABLES if name in arrays)
    definitions = {**settings(effective(program), precision), "SW_ALIGNMENT": alignment, **sizes}
    headers = ['"stillwake.h"', '"sw_weights.h"']
    return static_sources(precision) | {
        PROGRAM_SETTINGS: c_folder.settings_header(definitions),
        PROGRAM_WEIGHTS: c_folder.numbers_source("the numbers of one program", headers, constants, tables),
        image_payload.WEIGHTS_PART: b"".join(each.packed() for each in constants.values()),
    }


def with_answer(library: Mapping[str, bytes], answer: tuple[float, float]) -> dict[str, bytes]:
    """Return the library with the answer that `sw_known_answer` expects: the first action and the cost."""

    def member(values: Sequence[float]) -> Numbers:
        return Numbers(struct="sw_weights", members={"known_answer": np.array(values, np.float32)})

    unknown, known = (member(values).initialiser[1:-1].encode() for values in ((0.0, 0.0), answer))
    layout = ProgramSettings.of(library).text("SW_WEIGHTS_LAYOUT").split("; ")
    (place,) = (int(each.split()[-1]) for each in layout if each.startswith("known_answer "))
    source, packed = library[PROGRAM_WEIGHTS], bytearray(library[image_payload.WEIGHTS_PART])
    assert source.count(unknown) == 1
    values = member(answer).packed()
    packed[place : place + len(values)] = values
    return {**library, PROGRAM_WEIGHTS: source.replace(unknown, known), image_payload.WEIGHTS_PART: bytes(packed)}


def numbers(struct: str, arrays: Mapping[str, ArrayValues], alignment: int) -> Numbers:
    """Return the arrays as a C struct; raises ExportError for a value that float32 cannot represent."""
    members = {name.removeprefix("sw_"): _in_c(name, values) for name, values in arrays.items()}
    return Numbers(struct=struct, members=members, alignment=alignment)


def _in_c(name: str, values: ArrayValues) -> npt.NDArray[Any]:
    return np.asarray(values if np.issubdtype(values.dtype, np.integer) else as_float32(values, name))


def static_sources(precision: WeightPrecision) -> dict[str, bytes]:
    """Return the control step's sources that are equal for every program."""
    folders = ("common", precision, "step")
    return {name: text for folder in folders for name, text in sources_in(folder).items()}


def sources_in(folder: str) -> dict[str, bytes]:
    """Return the sources and headers of a folder of `sources`, by name."""
    return c_folder.c_files(files("export.to_c").joinpath("sources", folder))


def settings(program: ControllerProgram, precision: WeightPrecision) -> dict[str, int | str | np.float32]:
    """Return all definitions of `sw_settings.h`. Numbers that C and Python share are defined only in Python."""
    mpc = program.mpc
    beta1, beta2 = ADAM_BETAS
    return {
        "SW_PROGRAM_SHA256": program_sha256(program),
        "SW_DBC_SHA256": dbc_sha256(),
        "SW_SENSOR_NAMES": " ".join(program.sensors),
        "SW_PRECISION": precision,
        "SW_WINDOW": program.window,
        "SW_SENSORS": len(program.sensors),
        "SW_HORIZON": mpc.horizon,
        # In C, the index of a term is a definition whose name is `SW_` and the term's name in capitals.
        **{f"SW_{name.upper()}": index for index, name in enumerate(TERMS)},
        "SW_TERMS": len(TERMS),
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
        "SW_ENCODER_ROWS": program.encoder_rows,
        "SW_PRIOR_UNITS": 0 if program.prior is None else len(program.prior.output),
        "SW_PRIOR_MEMORY": 1 if program.prior is None else program.prior.memory,
        **({} if program.prior is None else prior_settings(program.prior)),
        **({"SW_LANES": FLOAT32_LANES} if precision == "float32" else c_constants()),
    }


def documents(library: Mapping[str, bytes]) -> dict[str, bytes]:
    """Return the README, the rules for CMake and the licence, with the sizes of this library filled in."""
    root = files("export.to_c").joinpath("folder")
    found = {name: root.joinpath(name).read_bytes() for name in DOCUMENTS}
    text = found["README.md"].decode("utf-8")
    for name, value in _facts(ProgramSettings.of(library)).items():
        text = text.replace(f"@{name}@", str(value))
    return {**found, "README.md": text.encode("utf-8")}


def replay(controller: Controller, windows: Sequence[Array], horizon: int) -> Array:
    """Return the expected answers of the example program to n windows (L, S+1), (n, 4): planned action, predicted mean
    Cd and Cl, and cost. Every answer starts from a plan of zeros, so that differences in rounding do not grow."""
    plan, free = np.zeros(horizon), np.ones(horizon)
    steps = [controller.control_step(window, plan, free) for window in windows]
    return np.array([[step.plan[0], *step.forces.mean(axis=0), step.cost] for step in steps])


def _facts(settings: ProgramSettings) -> dict[str, str | int]:
    window, sensors, horizon = (settings.number(f"SW_{name}") for name in ("WINDOW", "SENSORS", "HORIZON"))
    return {
        "PRECISION": settings.text("SW_PRECISION"),
        "WINDOW": window,
        "SENSORS": sensors,
        "SENSOR_NAMES": settings.text("SW_SENSOR_NAMES"),
        "HORIZON": horizon,
        "ITERATIONS": settings.number("SW_ITERATIONS"),
        "PROGRAM": settings.text("SW_PROGRAM_SHA256"),
        "INPUT_BYTES": 4 * (window * (sensors + 1) + 2 * horizon + len(TERMS) + 2),
        "OUTPUT_BYTES": 4 * (horizon * (1 + FORCES) + len(TERMS) + 1),
        "PRODUCTS": f"{settings.multiply_accumulates():,}",
    }
