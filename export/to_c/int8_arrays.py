"""A program's parameters in the layout of the int8 C sources (`export/to_c/sources/int8/sw_weights.h`).

Integers and scales are from the rounded program, as in the int8 ONNX graph. Biases are not rounded to int8. With int8
matrices and int16 activations, a sum of n products is at most 127 * qmax(n) * n, which is below 2^31. `c_constants`
writes this module's constants into `sw_settings.h`.
"""

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np
import numpy.typing as npt

from contract.arrays import Array
from contract.errors import ExportError
from export.int8 import Int8Matrix, RoundedProgram
from export.program.weights import LAYER_NORM_EPSILON, DecoderWeights, Norm
from export.to_c.float32_arrays import ArrayValues, Integers, optimiser_arrays, prior_arrays, scaling_arrays

_WORD: Final = 4
"""Number of int8 weights in a 32-bit word. A tile of a packed matrix has this number of rows, each of one word."""
INT8_LANES: Final = 2 * _WORD
"""Number of weights in two words. Every length is padded to a multiple of this number. The constants of a layer are
stored for this number of outputs at a time."""
ACTIVATION_MARGIN: Final = 1.5
"""An activation's integer saturates at this multiple of the largest activation in the calibration."""
AHEAD: Final = 16
"""Number of zeros after every matrix, because the C code loads weights ahead of their use."""
INT16_QMAX: Final = 32767
SUM_QMAX: Final = (2**31 - 1) // 127
"""Largest sum of a vector's magnitudes for which a dot product with int8 weights cannot overflow 32 bits."""
FULL_RANGE_WIDTH: Final = SUM_QMAX // INT16_QMAX
"""Largest length of a vector of 16-bit numbers whose dot product with int8 weights cannot overflow 32 bits."""
XHAT_QMAX: Final = 32767
"""The integer for the largest possible normalised value, which is sqrt(n) in a layer of width n."""
POINTS_PER_UNIT: Final = 32
"""Number of table points per unit of the argument; between points the function is interpolated linearly."""
ELU_ONE: Final = 4096
"""The integer for an ELU output of 1; all layers share one table. Outputs up to `ELU_RANGE` fit into 16 bits."""
ELU_RANGE: Final = 8
ELU_MAX: Final = 6.4
"""Largest output of an ELU that is accepted in the calibration; the rest of `ELU_RANGE` is a margin."""
ELU_ARGUMENT_ONE: Final = 1 << 18
"""The integer for an argument of 1 in the table of ELU."""
ELU_ARGUMENT_MAX: Final = 4000.0
"""Largest argument of an ELU. This argument times `ELU_ARGUMENT_ONE` fits in an int32 with one bit in reserve."""
SLOPE_SHIFT: Final = 4
"""Number of bits by which the integers of ELU slopes are shifted right, so that they can be stored as bytes on the
tape. The integer for a slope of 1 is `ELU_ONE` before the shift and 256 after it."""
GAIN_ONE: Final = 1 << 22
"""The integer for a layer's largest gain in its adjoint; times a slope of 256 a quarter of the range of an int32."""
ROW_SCALE_ONE: Final = 1 << 23
"""The integer for the largest row scale of a layer's matrix in the layer's adjoint."""
SCALED_BITS: Final = 32
"""Number of fractional bits of the factor in C's sw_scaled, which is below 1/2."""
LOGISTIC_ONE: Final = 16384
"""The integer for an argument of 1 in the table of the logistic function."""
LOGISTIC_QMAX: Final = 32767
"""The integer for a value of 1 in the table of the logistic function."""
LOGISTIC_RANGE: Final = 16
GATE_MAX: Final = 6e4
"""Largest argument of a gate. Twice this argument times `LOGISTIC_ONE` fits in an int32."""


def c_constants() -> dict[str, int | np.float32]:
    """Return the definitions of `sw_settings.h` for the int8 sources, except sizes."""
    return {
        "SW_LANES": INT8_LANES,
        "SW_AHEAD": AHEAD,
        "SW_INT16_QMAX": INT16_QMAX,
        "SW_SUM_QMAX": SUM_QMAX,
        "SW_FULL_RANGE_WIDTH": FULL_RANGE_WIDTH,
        "SW_XHAT_QMAX": np.float32(XHAT_QMAX),
        "SW_POINTS_PER_UNIT": POINTS_PER_UNIT,
        "SW_ELU_ONE": ELU_ONE,
        "SW_ELU_RANGE": ELU_RANGE,
        "SW_ELU_ARGUMENT_ONE": ELU_ARGUMENT_ONE,
        "SW_SLOPE_SHIFT": SLOPE_SHIFT,
        "SW_LOGISTIC_ONE": LOGISTIC_ONE,
        "SW_LOGISTIC_RANGE": LOGISTIC_RANGE,
        "SW_LOGISTIC_QMAX": LOGISTIC_QMAX,
    }


def qmax(width: int) -> int:
    """Return the limit on the integers in a vector of this padded width, with which the vector's dot product with int8
    weights cannot overflow 32 bits (SW_QMAX in C). Raises ExportError if the vector is too wide."""
    if width > 4 * FULL_RANGE_WIDTH:
        raise ExportError(f"a layer has the width {width}; the int8 library accepts at most {4 * FULL_RANGE_WIDTH}")
    return INT16_QMAX if width <= FULL_RANGE_WIDTH else SUM_QMAX // width


def padded_size(size: int) -> int:
    """Round a length up to a multiple of `INT8_LANES`."""
    return size + -size % INT8_LANES


def packed(values: npt.NDArray[np.int8]) -> npt.NDArray[np.int8]:
    """Pack a matrix for `sw_dots` in tiles of 4 x 4 weights. Tiles of the same matrix rows are adjacent; the four
    weights of a row in a tile have the order 0, 2, 1, 3."""
    whole = np.pad(values, [(0, -size % INT8_LANES) for size in values.shape])
    outputs, inputs = whole.shape
    tiles = whole.reshape(outputs // _WORD, _WORD, inputs // _WORD, _WORD)[..., [0, 2, 1, 3]]
    return np.append(tiles.transpose(0, 2, 1, 3).ravel(), np.zeros(AHEAD, np.int8))


def elu_points() -> npt.NDArray[np.uint32]:
    """Return the table of ELU for C's sw_between, at the points -8, -8 + 1/32, .. below 8. The values are in units of
    1 / `ELU_ONE`, and are limited to the largest int16."""

    def elu(x: Array) -> Array:
        return np.asarray(np.minimum(ELU_ONE * np.where(x < 0, np.expm1(np.minimum(x, 0)), x), INT16_QMAX))

    return _points(elu, ELU_RANGE)


def logistic_points() -> npt.NDArray[np.uint32]:
    """Return the table of the logistic function for C's sw_between, at the points -16, -16 + 1/32, .. below 16. The
    values are in units of 1 / `LOGISTIC_QMAX`."""
    return _points(lambda x: LOGISTIC_QMAX / (1.0 + np.exp(-x)), LOGISTIC_RANGE)


def _points(function: Callable[[Array], Array], reach: float) -> npt.NDArray[np.uint32]:
    spacing = 1 / POINTS_PER_UNIT
    values = np.rint(function(np.arange(-reach, reach + spacing, spacing))).astype(np.int64)
    return (values[:-1] % (1 << 16) + (np.diff(values) << 16)).astype(np.uint32)


def int8_arrays(rounded: RoundedProgram, ranges: Mapping[str, float]) -> dict[str, ArrayValues]:
    """Return every array of `sw_weights.h` by its C name: matrices in int8, tables in uint32, constants of layers with
    a norm in int32, all other arrays in float64. `ranges` is a result of `activation_ranges`. Raises ExportError for a
    decoder without residual blocks, a layer that is too wide, a layer with ELU outputs near the end of their range, or
    an LSTM whose weights are too large."""
    program = rounded.program
    if not program.decoder.blocks:
        raise ExportError("decoder: has no residual block, but the C library needs one or more")
    of_elu = ("encoder.output.weight", "dynamics.hidden.weight", "dynamics.output.weight")
    reach = max(largest for name, largest in ranges.items() if name in of_elu or name.endswith(".elu"))
    if not reach < ELU_MAX:
        raise ExportError(f"int8 calibration: ELU outputs reach {reach:.3g}; the limit is {ELU_MAX}")
    return {
        **scaling_arrays(program),
        "sw_logistic_points": logistic_points(),
        "sw_elu_points": elu_points(),
        "sw_action_factor": np.array(1.0 / program.scaling.action_std),
        **_encoder(rounded, ranges),
        **_dynamics(rounded, ranges),
        **_decoder(rounded, ranges),
        **optimiser_arrays(program),
        **prior_arrays(program, rounded.matrices),
    }


def _inverse_scale(largest: float, width: int) -> float:
    """Return the factor that converts an activation to its integer, or any factor if the largest activation is 0."""
    return qmax(padded_size(width)) / (ACTIVATION_MARGIN * largest if largest > 0 else 1.0)


def _largest_state(ranges: Mapping[str, float]) -> float:
    """Return the largest magnitude in the inputs of dynamics and decoder. These inputs share one scale."""
    return max(ranges["dynamics.input.weight"], ranges["decoder.input.weight"])


def _channels(*columns: Array) -> Array:
    """Return the constants of n outputs in groups of eight outputs, (n / 8, constants, 8), padded with zeros."""
    rows = np.pad(np.stack(columns, axis=-1), [(0, -len(columns[0]) % INT8_LANES), (0, 0)])
    return rows.reshape(-1, INT8_LANES, len(columns)).transpose(0, 2, 1)


def _layer(name: str, matrix: Int8Matrix, bias: Array, norm: Norm, inverse_scale: float) -> Mapping[str, ArrayValues]:
    """Return the constants of a layer with norm and ELU: `sw_NAME_channel`, `sw_NAME_adjoint` and `sw_NAME_layer`. In
    C, a scaled sum is an integer multiple of a unit. The unit is the smallest with which the factor of C's sw_scaled is
    below 1/2 and the sum over all outputs cannot overflow."""
    _stay_below(ELU_ARGUMENT_MAX, np.abs(norm.weight) * np.sqrt(len(bias)) + np.abs(norm.bias), "ELUs behind a norm")
    scales = matrix.scales.astype(np.float64) / inverse_scale
    reach = np.abs(matrix.values.astype(np.float64)).sum(axis=1) * (INT16_QMAX + 1) * scales + np.abs(bias)
    unit = 1.001 * max(2.0 * scales.max(), reach.sum() / 2**31)
    gain = ELU_ARGUMENT_ONE * norm.weight * np.sqrt(len(bias)) / XHAT_QMAX * 2**16
    offset = ELU_ARGUMENT_ONE * (norm.bias + ELU_RANGE)
    gain_max = np.abs(norm.weight).max() or 1.0
    largest = float(matrix.scales.max())
    # The upper 32 bits of a value times the integers of the largest gain and a slope of 1 are a quarter of the value.
    quarter = GAIN_ONE * 256 / 2**SCALED_BITS
    return {
        f"sw_{name}_channel": _integers(_channels(scales / unit * 2**SCALED_BITS, bias / unit, gain, offset)),
        f"sw_{name}_adjoint": _integers(
            _channels(GAIN_ONE * norm.weight / gain_max, ROW_SCALE_ONE * matrix.scales.astype(np.float64) / largest)
        ),
        f"sw_{name}_layer": np.array([LAYER_NORM_EPSILON / unit**2, gain_max / quarter * largest / unit]),
    }


def _integers(values: Array) -> Integers:
    return np.rint(values).astype(np.int32)


def _plain(matrix: Int8Matrix, bias: Array, inverse_scale: float) -> Array:
    return _channels(matrix.scales.astype(np.float64) / inverse_scale, bias)


def _scales(matrix: Int8Matrix) -> Array:
    return np.pad(matrix.scales.astype(np.float64), (0, -len(matrix.scales) % INT8_LANES))


def _encoder(rounded: RoundedProgram, ranges: Mapping[str, float]) -> Mapping[str, ArrayValues]:
    weights, matrices = rounded.program.encoder, rounded.matrices
    lstm = weights.lstm
    by_input, by_hidden = matrices["lstm.weight_input"], matrices["lstm.weight_recurrent"]
    head, output = matrices["encoder.hidden.weight"], matrices["encoder.output.weight"]
    row = _inverse_scale(ranges["lstm.weight_input"], weights.inputs)
    # The hidden state never leaves [-1, 1], so its scale needs no calibration.
    cell = float(qmax(padded_size(lstm.width)))
    middle = _inverse_scale(ranges["encoder.hidden.weight"], lstm.width)
    reach = np.abs(lstm.weight_input).sum(axis=1) * ACTIVATION_MARGIN * ranges["lstm.weight_input"]
    reach += np.abs(lstm.weight_recurrent).sum(axis=1)
    _stay_below(GATE_MAX, reach + np.abs(lstm.bias_input + lstm.bias_recurrent), "the LSTM's gates")
    of_head = np.abs(weights.hidden.weight).sum(axis=1) * ACTIVATION_MARGIN * ranges["encoder.hidden.weight"]
    _stay_below(ELU_ARGUMENT_MAX, of_head + np.abs(weights.hidden.bias), "the encoder's ELUs")
    _fed_by_elu(weights.output.weight)
    # C computes tanh(x) of gate g as 2 logistic(2 x) - 1, so the argument of this gate is doubled.
    arguments = LOGISTIC_ONE * np.repeat([1.0, 1.0, 2.0, 1.0], lstm.width)
    by_gate = (
        by_input.scales / row * arguments,
        by_hidden.scales / cell * arguments,
        (lstm.bias_input + lstm.bias_recurrent) * arguments + LOGISTIC_RANGE * LOGISTIC_ONE + 0.5,
    )
    channels = zip(*(np.split(values, 4) for values in by_gate), strict=True)
    return {
        "sw_lstm_input_rows": packed(_gates(by_input.values)),
        "sw_lstm_hidden_rows": packed(_gates(by_hidden.values)),
        "sw_lstm_channel": np.concatenate([_channels(*gate) for gate in channels]),
        "sw_encoder_gain": np.pad(weights.norm.weight, (0, -lstm.width % INT8_LANES)),
        "sw_encoder_offset": np.pad(weights.norm.bias, (0, -lstm.width % INT8_LANES)),
        "sw_head_rows": packed(head.values),
        "sw_head_channel": _plain(head, weights.hidden.bias, middle),
        "sw_latent_rows": packed(output.values),
        "sw_latent_channel": _plain(output, weights.output.bias, ELU_ONE),
        "sw_row_inverse_scale": np.array(row),
        "sw_cell_inverse_scale": np.array(cell),
        "sw_head_inverse_scale": np.array(middle),
    }


def _stay_below(limit: float, reach: Array, what: str) -> None:
    if not np.max(reach) < limit:
        raise ExportError(f"int8 library: {what} reach {np.max(reach):.3g}; the limit is {limit:.3g}")


def _fed_by_elu(weight: Array) -> None:
    """Check a layer's width: its inputs, ELU outputs, use all 16 bits, so the sum of a wide layer could overflow."""
    if weight.shape[1] > FULL_RANGE_WIDTH:
        raise ExportError(
            f"a layer after an ELU has the width {weight.shape[1]}; the int8 library accepts at most {FULL_RANGE_WIDTH}"
        )


def _gates(stacked: npt.NDArray[np.int8]) -> npt.NDArray[np.int8]:
    return np.concatenate([np.pad(gate, [(0, -len(gate) % INT8_LANES), (0, 0)]) for gate in np.split(stacked, 4)])


def _dynamics(rounded: RoundedProgram, ranges: Mapping[str, float]) -> Mapping[str, ArrayValues]:
    weights, matrices = rounded.program.dynamics, rounded.matrices
    first, second = matrices["dynamics.input.weight"], matrices["dynamics.hidden.weight"]
    third = matrices["dynamics.output.weight"]
    state = _inverse_scale(_largest_state(ranges), weights.latent + 1)
    for layer in (weights.hidden, weights.output):
        _fed_by_elu(layer.weight)
    return {
        "sw_dyn1_rows": packed(first.values),
        "sw_dyn1_adjoint_rows": packed(first.values.T),
        **_layer("dyn1", first, weights.input.bias, weights.norm_in, state),
        "sw_dyn2_rows": packed(second.values),
        "sw_dyn2_adjoint_rows": packed(second.values.T),
        **_layer("dyn2", second, weights.hidden.bias, weights.norm_hidden, ELU_ONE),
        "sw_dyn3_rows": packed(third.values),
        "sw_dyn3_adjoint_rows": packed(third.values.T),
        "sw_dyn3_channel": _plain(third, weights.output.bias, ELU_ONE),
        "sw_dyn3_scale": _scales(third),
        "sw_state_inverse_scale": np.array(state),
    }


def _decoder(rounded: RoundedProgram, ranges: Mapping[str, float]) -> Mapping[str, ArrayValues]:
    weights, matrices = rounded.program.decoder, rounded.matrices
    width = len(weights.input.bias)
    first, last = matrices["decoder.input.weight"], matrices["decoder.output.weight"]
    names = [f"decoder.blocks.{i}.linear.weight" for i in range(len(weights.blocks))]
    blocks = [matrices[name] for name in names]
    latent = _inverse_scale(_largest_state(ranges), weights.latent)
    inputs = [_inverse_scale(ranges[name], width) for name in names]
    output = _inverse_scale(ranges["decoder.output.weight"], width)
    unit = _residual_unit(first, weights, latent, max(*inputs, output))
    layers = [
        _layer("block", matrix, block.linear.bias, block.norm, inverse_scale)
        for matrix, block, inverse_scale in zip(blocks, weights.blocks, inputs, strict=True)
    ]
    return {
        "sw_decoder_rows": packed(first.values),
        "sw_decoder_adjoint_rows": packed(first.values.T),
        "sw_decoder_channel": _channels(first.scales.astype(np.float64) / latent / unit, weights.input.bias / unit),
        "sw_decoder_scale": _integers(_scales(first) / first.scales.max() * (2**31 - 1)),
        # The scale is doubled because C's sw_scaled with a factor of 2^31 halves its argument.
        "sw_decoder_largest": np.array(2.0 * first.scales.max()),
        "sw_block_rows": np.array([packed(matrix.values) for matrix in blocks]),
        "sw_block_adjoint_rows": np.array([packed(matrix.values.T) for matrix in blocks]),
        **{name: np.array([layer[name] for layer in layers]) for name in layers[0]},
        "sw_force_rows": packed(last.values),
        "sw_force_adjoint_rows": packed(last.values.T),
        "sw_force_channel": _plain(last, weights.output.bias, output),
        "sw_force_scale": _scales(last),
        "sw_decoder_inverse_scale": np.array(latent),
        "sw_residual_of_elu": _integers(np.array(1.0 / ELU_ONE / unit)),
        "sw_residual_factor": _integers(np.array([*inputs, output]) * unit * 2**SCALED_BITS),
    }


def _residual_unit(first: Int8Matrix, weights: DecoderWeights, latent: float, finest: float) -> float:
    """Return the unit of the decoder's int32 residual sum. The unit is the smallest with which the sum cannot overflow,
    but at least 1/512 of the finest unit of the layers' inputs, which are computed from the sum."""
    sums = np.abs(first.values.astype(np.float64)).sum(axis=1) * (INT16_QMAX + 1) * first.scales / latent
    reach = np.max(sums + np.abs(weights.input.bias)) + len(weights.blocks) * ELU_RANGE
    unit = max(1.0 / finest / 512.0, 1.01 * float(reach) / 2**31)
    _stay_below(0.5, np.array(unit * finest), "sums of the decoder's residuals, in integers of its finest layer,")
    _stay_below(2.0**16, np.array(1.0 / ELU_ONE / unit), "an ELU's integer in units of the decoder's residuals,")
    return unit
