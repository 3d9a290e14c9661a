"""A program's parameters in the layout of the C sources (`export/to_c/sources/float32/sw_weights.h`).

The numbers are derived in float64 and rounded once. Matrices are centred if a layer norm follows, the action's row is
multiplied by 1 / action_std, and the two biases of the LSTM are added. Vectors are padded to whole registers.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from contract.arrays import Array
from contract.controller.goal import DEAREST_EFFORT, DEAREST_LIFT, NARROWEST, SCHEDULED, SPEED_SCALE
from contract.errors import ExportError
from export.int8 import Int8Matrix
from export.program.controller_program import ControllerProgram
from export.program.weights import PriorWeights, float32_within
from export.reference.mpc import ADAM_BETAS

Integers = npt.NDArray[np.int32]
ArrayValues = Array | npt.NDArray[np.int8] | Integers | npt.NDArray[np.uint32]
"""An array of numbers for C. Integers keep their type in C; float64 becomes float."""
FLOAT32_LANES = 16
"""Number of float32 values in the widest vector register that compilers should be able to fill."""
PRIOR_UNITS_AT_A_TIME = 8
"""Number of the prior's units that `sw_prior.c` computes together."""


def float_arrays(program: ControllerProgram) -> dict[str, ArrayValues]:
    """Return every array of `sw_weights.h` by its C name. Raises ExportError for a decoder without residual blocks."""
    return {
        **scaling_arrays(program),
        **_encoder(program),
        **_dynamics(program),
        **_decoder(program),
        **optimiser_arrays(program),
        **prior_arrays(program, {}),
    }


def padded(values: Array) -> Array:
    """Append zeros along the last axis, up to a multiple of `FLOAT32_LANES`."""
    missing = -values.shape[-1] % FLOAT32_LANES
    return np.pad(values, [(0, 0)] * (values.ndim - 1) + [(0, missing)])


def centred(values: Array) -> Array:
    """Subtract the mean over the first axis (the n outputs of a layer) from a weight matrix or a bias vector."""
    return np.asarray(values - values.mean(axis=0))


def scaling_arrays(program: ControllerProgram) -> dict[str, Array]:
    scaling = program.scaling
    return {
        "sw_window_mean": np.array(scaling.window_mean),
        "sw_window_factor": 1.0 / np.array(scaling.window_std),
        "sw_force_mean": np.array(scaling.force_mean),
        "sw_force_std": np.array(scaling.force_std),
        "sw_action_limit": np.array(float32_within(program.action_limit)),
    }


def _encoder(program: ControllerProgram) -> dict[str, Array]:
    weights = program.encoder
    lstm = weights.lstm
    both = np.concatenate([lstm.weight_input, lstm.weight_recurrent], axis=1)
    return {
        "sw_lstm_weight": _gates(both.T),
        "sw_lstm_bias": _gates(lstm.bias_input + lstm.bias_recurrent),
        "sw_encoder_gain": padded(weights.norm.weight),
        "sw_encoder_offset": padded(weights.norm.bias),
        "sw_head_weight": padded(weights.hidden.weight.T),
        "sw_head_bias": padded(weights.hidden.bias),
        "sw_latent_weight": padded(weights.output.weight),
        "sw_latent_bias": weights.output.bias,
    }


def _gates(stacked: Array) -> Array:
    """Join the four gates along the last axis; each gate is padded separately."""
    return np.concatenate([padded(gate) for gate in np.split(stacked, 4, axis=-1)], axis=-1)


def _dynamics(program: ControllerProgram) -> dict[str, Array]:
    weights = program.dynamics
    by_input = centred(weights.input.weight).T.copy()
    by_input[-1] /= program.scaling.action_std
    return {
        "sw_dyn1_weight": padded(by_input),
        "sw_dyn1_bias": padded(centred(weights.input.bias)),
        "sw_dyn1_gain": padded(weights.norm_in.weight),
        "sw_dyn1_offset": padded(weights.norm_in.bias),
        "sw_dyn2_weight": padded(centred(weights.hidden.weight).T),
        "sw_dyn2_bias": padded(centred(weights.hidden.bias)),
        "sw_dyn2_gain": padded(weights.norm_hidden.weight),
        "sw_dyn2_offset": padded(weights.norm_hidden.bias),
        "sw_dyn3_weight": padded(weights.output.weight),
        "sw_dyn3_bias": weights.output.bias,
    }


def _decoder(program: ControllerProgram) -> dict[str, Array]:
    weights = program.decoder
    if not weights.blocks:
        raise ExportError("decoder: has no residual block, but the C library needs one or more")
    return {
        "sw_decoder_weight": weights.input.weight,
        "sw_decoder_bias": weights.input.bias,
        "sw_block_weight": np.array([centred(block.linear.weight) for block in weights.blocks]),
        "sw_block_bias": np.array([centred(block.linear.bias) for block in weights.blocks]),
        "sw_block_gain": np.array([block.norm.weight for block in weights.blocks]),
        "sw_block_offset": np.array([block.norm.bias for block in weights.blocks]),
        "sw_force_weight": weights.output.weight,
        "sw_force_bias": weights.output.bias,
    }


def optimiser_arrays(program: ControllerProgram) -> dict[str, Array]:
    """Return the reference drag of the cost, Adam's factors for every iteration, the default cost weights, and two
    zeros that `with_answer` replaces by the known answer."""
    beta1, beta2 = ADAM_BETAS
    number = np.arange(1, program.mpc.iterations + 1)
    return {
        "sw_drag_reference": np.array(program.mpc.drag_reference),
        "sw_adam_rate": program.mpc.learning_rate / (1.0 - beta1**number),
        "sw_adam_unbias": 1.0 / np.sqrt(1.0 - beta2**number),
        "sw_adam_epsilon": np.array(program.mpc.epsilon),
        "sw_default_weights": np.array(program.mpc.weights.as_tuple()),
        "sw_known_answer": np.zeros(2),
    }


def prior_arrays(program: ControllerProgram, integers: Mapping[str, Int8Matrix]) -> dict[str, ArrayValues]:
    """Return the prior's filters without the zero rows at their ends, and the weights of the prior's layers.
    Without a prior, the mapping is empty. `integers` has the integers of the prior's two matrices by name; a matrix
    without integers is stored as floats with scale 1."""
    if program.prior is None:
        return {}
    prior, units = program.prior, len(program.prior.output)
    ranges = _filter_ranges(prior)
    first, first_scale = _stored(prior.first.reshape(-1, prior.first[0, 0].size), integers.get("prior.first"))
    sums, sums_scale = _stored(prior.sums.reshape(units, -1), integers.get("prior.sums"))
    by_unit = {
        # For each input of a unit, the weights for the schedule variables are adjacent.
        "sw_prior_first": first.reshape(-1, units, first.shape[1]).transpose(1, 2, 0),
        "sw_prior_first_scale": first_scale.reshape(-1, units).T,
        "sw_prior_gate": prior.gate,
        "sw_prior_sums": sums,
        "sw_prior_sums_scale": sums_scale,
        "sw_prior_output": prior.output,
    }
    return {
        "sw_prior_filter_rows": ranges,
        "sw_prior_filter": np.concatenate(
            [column[begin : begin + count] for column, (begin, count) in zip(prior.filters.T, ranges, strict=True)]
        ),
        **{name: _filled(values) for name, values in by_unit.items()},
        "sw_prior_predictor": prior.predictor.reshape(prior.pairs, -1),
    }


def _stored(matrix: Array, integers: Int8Matrix | None) -> tuple[Array | npt.NDArray[np.int8], Array]:
    if integers is None:
        return matrix, np.ones(len(matrix))
    return integers.values, integers.scales.astype(np.float64)


def _filled(by_unit: Any) -> Any:
    return np.pad(by_unit, [(0, -len(by_unit) % PRIOR_UNITS_AT_A_TIME)] + [(0, 0)] * (by_unit.ndim - 1))


def prior_settings(prior: PriorWeights) -> dict[str, int | np.float32]:
    """Return the entries of `sw_settings.h` for the filters, the schedule variables, and the goals of a prior."""
    ranges = _filter_ranges(prior)
    return {
        "SW_PRIOR_FILTERS": len(ranges),
        "SW_PRIOR_FILTER_ROWS": int(ranges[:, 1].sum()),
        "SW_SCHEDULED": len(SCHEDULED),
        "SW_SPEED_SCALE": np.float32(SPEED_SCALE),
        "SW_PRIOR_KNOWS_GOAL": int(prior.knows_goal),
        "SW_DEAREST_EFFORT": np.float32(DEAREST_EFFORT),
        "SW_DEAREST_LIFT": np.float32(DEAREST_LIFT),
        "SW_NARROWEST": np.float32(NARROWEST),
    }


def _filter_ranges(prior: PriorWeights) -> Integers:
    """Return the first nonzero row of each of F filters, and the number of rows from there to the last one, (F, 2)."""
    ranges = []
    for column in prior.filters.T:
        read = np.flatnonzero(column) if column.any() else np.zeros(1, int)
        ranges.append((read[0], read[-1] + 1 - read[0]))
    return np.array(ranges, dtype=np.int32)
