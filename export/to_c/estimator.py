"""The sizes and the weights of a release's sensor estimator as C source, for `ecu/c/sw_estimator.h`. Its matrices are
int8 with one scale per output, as in `sensors.onnx`; biases, standardisation and the small last layer are float32."""

from collections.abc import Mapping
from typing import Final

import numpy as np

from contract.controller import image_payload
from contract.controller.c_folder import generated_header, numbers_source
from contract.controller.estimator import ESTIMATOR, REACH
from contract.errors import ExportError
from export.int8 import RoundedEstimator
from export.to_c.float32_arrays import ArrayValues
from export.to_c.int8_arrays import FULL_RANGE_WIDTH, INT8_LANES, INT16_QMAX, packed
from export.to_c.library import ALIGNMENTS, numbers
from export.to_onnx.sensor_estimator import read_estimator

SIZES: Final = "sw_estimator_settings.h"
NUMBERS: Final = "sw_estimator_weights.c"
ONE: Final = int(INT16_QMAX / REACH)
"""Integer that represents 1: a set flag, or one standard deviation. Readings within `REACH` fit into 16 bits."""


def estimator_files(content: bytes) -> dict[str, bytes]:
    """Generate the estimator's C files from a verified bundle's `sensors.onnx`, and return them by name. Raises
    ExportError for a network that the C sources cannot compute; the message states the supported networks."""
    rounded = read_estimator(content)
    _check(rounded)
    found = numbers("sw_estimator_weights", _arrays(rounded), ALIGNMENTS["int8"])
    window, width = rounded.network.window, len(rounded.network.layers[0][1])
    definitions = {
        "SW_ESTIMATOR_ROWS": window,
        "SW_ESTIMATOR_WIDTH": width,
        "SW_ESTIMATOR_LONGEST": max(window, width),
        "SW_ESTIMATOR_ONE": ONE,
        "SW_ESTIMATOR_LIMIT": int(REACH * ONE),
        **found.settings("SW_ESTIMATOR"),
    }
    sizes = generated_header(SIZES, "the sizes of a release's sensor estimator", definitions)
    source = numbers_source("the numbers of a release's sensor estimator", ['"sw_ecu.h"'], {"sw_own_estimator": found})
    return {SIZES: sizes, NUMBERS: source, image_payload.ESTIMATOR_PART: found.packed()}


def _check(rounded: RoundedEstimator) -> None:
    network = rounded.network
    shapes = [matrix.values.shape for matrix in rounded.matrices]
    width = shapes[0][0]
    inputs = network.window * (network.sensors + 1) + network.sensors
    if shapes != [(width, inputs), (width, width), (network.sensors, width)]:
        raise ExportError(f"{ESTIMATOR}: has layers of shapes {shapes}, but must have two hidden layers of equal width")
    for name, size in (("its hidden layers are", width), ("the window is", network.window)):
        if size % INT8_LANES:
            raise ExportError(f"{ESTIMATOR}: {name} {size} long: the C library accepts multiples of {INT8_LANES}")
    if max(inputs, width) > FULL_RANGE_WIDTH:
        raise ExportError(
            f"{ESTIMATOR}: a layer has {max(inputs, width)} inputs; the C library accepts at most {FULL_RANGE_WIDTH}"
        )


def _arrays(rounded: RoundedEstimator) -> Mapping[str, ArrayValues]:
    network, (first, second, last) = rounded.network, rounded.matrices
    sensors, columns = network.sensors, network.sensors + 1
    by_row = first.values[:, : network.window * columns].reshape(-1, network.window, columns)
    biases = [bias for _, bias in network.layers]
    return {
        "mean": network.mean,
        "factor": ONE / network.std,
        "column_rows": np.array([packed(by_row[:, :, column]) for column in range(columns)]),
        "flags": first.values[:, -sensors:].T,
        "first_scale": first.scales.astype(np.float64) / ONE,
        "first_bias": biases[0],
        "second_rows": packed(second.values),
        "second_scale": second.scales.astype(np.float64),
        "second_bias": biases[1],
        "last": last.dequantised().astype(np.float64),
        "last_bias": biases[2],
        "spread": network.std[:-1],
    }
