"""The rounding of weights to integers. Weights are rounded once, so that all int8 lowerings have equal integers. The
reference uses the program with dequantised weights. The manifest and the C header state the hash of this program.

Weights are symmetric int8 with one scale per output row. Biases and norms remain float; ONNX also computes in float. A
weight W[r, c] becomes scale[r] * q[r, c] with an integer q in -127 .. 127 and scale[r] = max_c |W[r, c]| / 127. With
int8 the ONNX file is a quarter as large; on x86 the control step is not faster. The sensor estimator's weights are
rounded to the nearest integers, with the same scales.

A program is rounded with error feedback (`quantise_on`), which needs inputs of every layer. These inputs come from
recorded windows: the encoder runs over the windows. Dynamics and decoder run over roll-outs from every window's latent
state with a few plans: zero, full amplitude in either direction, random plans, and random walks that resemble an
optimised plan. The integer scales of an int8 lowering's activations follow from the largest magnitudes in these inputs.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from contract.arrays import Array
from contract.controller.estimator import EstimatorNetwork
from contract.errors import ExportError
from contract.release.manifest import WeightPrecision
from export.program.controller_program import ControllerProgram, map_matrices
from export.program.weights import PriorWeights, as_float32
from export.reference.model import decoder_layers, dynamics_layers, encoder_layers, linear
from export.reference.mpc import rollout
from export.reference.prior import filtered_sums, past_of

QMAX: Final = 127
"""Largest magnitude of a quantised weight. The integer -128 is not used, so that a row can be negated exactly."""
DAMPING: Final = 0.01
"""Share of the mean diagonal entry of H (see `quantise_on`) that is added to every diagonal entry of H, so that errors
also count in directions in which the inputs do not vary."""
_RANDOM: Final = 2
_WANDERING: Final = 2
_STRIDE: Final = 0.25
"""Standard deviation of a random walk's steps, as a share of the action limit."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Int8Matrix:
    """A matrix as int8 values (outputs, inputs), and one positive float32 scale per output."""

    values: npt.NDArray[np.int8]
    scales: npt.NDArray[np.float32]

    def dequantised(self) -> npt.NDArray[np.float32]:
        """Return the weights scale[r] * q[r, c], rounded to float32 as ONNX's DequantizeLinear does."""
        return self.values.astype(np.float32) * self.scales[:, None]


def quantise_matrix(weight: Array) -> Int8Matrix:
    """Round each weight of a matrix (outputs, inputs) to the nearest integer."""
    scales = row_scales(weight)
    steps = np.rint(weight / scales[:, None].astype(np.float64))
    return Int8Matrix(values=np.clip(steps, -QMAX, QMAX).astype(np.int8), scales=scales)


def row_scales(weight: Array) -> npt.NDArray[np.float32]:
    """Return the scale of every row: the row's largest magnitude divided by 127, or 1 for a row of zeros."""
    largest = np.abs(weight).max(axis=1)
    # The scale must be a normal float32; with a smaller scale, the row's products would vanish in float32 anyway.
    return np.where(largest > 0, np.maximum(largest / QMAX, np.finfo(np.float32).tiny), 1.0).astype(np.float32)


@dataclass(frozen=True, kw_only=True, eq=False)
class RoundedProgram:
    """A program with int8 weights. `source` is the program before rounding. `program` has the dequantised weights, for
    the reference. `matrices` has integers and scales by matrix name (`export.program.controller_program`)."""

    source: ControllerProgram
    program: ControllerProgram
    matrices: Mapping[str, Int8Matrix]

    @classmethod
    def of(cls, source: ControllerProgram, rounding: Callable[[str, Array], Int8Matrix]) -> "RoundedProgram":
        """Round every matrix with `rounding(name, matrix)`. Raises ExportError if float32 cannot hold it."""
        stored: dict[str, Int8Matrix] = {}

        def change(name: str, weight: Array) -> Array:
            as_float32(weight, name)  # raises ExportError if float32 cannot hold a weight; the scales are float32
            rounded = rounding(name, weight)
            dequantised = rounded.dequantised().astype(np.float64)
            # In one of 128 rows, the stored scale differs by one float32 ulp from the scale used for rounding.
            stored[name] = Int8Matrix(values=rounded.values, scales=row_scales(dequantised))
            return dequantised

        program = map_matrices(source, change)
        return cls(source=source, program=program, matrices=stored)


Program = ControllerProgram | RoundedProgram
"""A program for ONNX or C; its type determines the precision of the weights."""


def effective(program: Program) -> ControllerProgram:
    """Return the program with the weights that a lowering and the reference must use."""
    return program.program if isinstance(program, RoundedProgram) else program


def precision_of(program: Program) -> WeightPrecision:
    """Return the precision of the weights, by its name in manifests and headers."""
    return "int8" if isinstance(program, RoundedProgram) else "float32"


def rounded_to_nearest(program: ControllerProgram) -> RoundedProgram:
    return RoundedProgram.of(program, lambda _, weight: quantise_matrix(weight))


@dataclass(frozen=True, kw_only=True, eq=False)
class RoundedEstimator:
    """The sensor estimator of a bundle: its network with the dequantised weights, and the integers of each layer."""

    network: EstimatorNetwork
    matrices: Sequence[Int8Matrix]


def rounded_estimator(network: EstimatorNetwork) -> RoundedEstimator:
    """Round each weight of a network to the nearest integer; a network that is already rounded does not change."""
    matrices = [quantise_matrix(weight) for weight, _ in network.layers]
    pairs = zip(matrices, network.layers, strict=True)
    layers = [(matrix.dequantised().astype(float), bias) for matrix, (_, bias) in pairs]
    return RoundedEstimator(network=replace(network, layers=layers), matrices=matrices)


def quantise_on(weight: Array, inputs: Array) -> Int8Matrix:
    """Round a matrix (outputs, m) to an Int8Matrix, so that its products with n inputs (n, m) change little.

    Nearest rounding minimises the error of each weight alone. But the error that counts is |X (W - W_q)^T|^2, and the
    inputs X are correlated: later columns can compensate one column's effect on an output. Let H = X^T X / n + damping,
    with the upper Cholesky factor U of H^-1 = U^T U. If rounding changes column j by e, each later column k changes by
    -e U_jk / U_jj, the best compensation (optimal brain surgeon; Frantar et al., "GPTQ", ICLR 2023).

    The scales are as in `quantise_matrix`. The largest weight of a row determines the row's scale and is rounded to the
    nearest integer. So rounding the result a second time changes no integer.
    """
    nearest = quantise_matrix(weight)
    scales = nearest.scales.astype(np.float64)
    covariance = inputs.T @ inputs / len(inputs)
    # If all inputs are zero, any positive number serves as damping.
    damping = DAMPING * covariance.trace() / len(covariance) or 1.0
    inverse = np.linalg.inv(covariance + damping * np.eye(len(covariance)))
    upper = np.linalg.cholesky(inverse).T

    rest, steps, largest = weight.copy(), np.zeros_like(weight), np.abs(weight).argmax(axis=1)
    for j in range(weight.shape[1]):
        rounded = np.clip(np.rint(rest[:, j] / scales), -QMAX, QMAX)
        steps[:, j] = np.where(largest == j, nearest.values[:, j], rounded)
        error = (rest[:, j] - steps[:, j] * scales) / upper[j, j]
        rest[:, j + 1 :] -= np.outer(error, upper[j, j + 1 :])
    return Int8Matrix(values=steps.astype(np.int8), scales=nearest.scales)


def rounded_on(program: ControllerProgram, windows: Sequence[Array]) -> RoundedProgram:
    """Round weights with `quantise_on` and recorded windows (L, S+1). Raises ExportError without windows."""
    inputs = layer_inputs(program, windows)
    return RoundedProgram.of(program, lambda name, weight: quantise_on(weight, inputs[name]))


def activation_ranges(program: ControllerProgram, windows: Sequence[Array]) -> dict[str, float]:
    """Return the largest magnitude of each array of `layer_inputs`, by name. Raises the errors of `layer_inputs`."""
    return {name: float(np.abs(values).max()) for name, values in layer_inputs(program, windows).items()}


def layer_inputs(program: ControllerProgram, windows: Sequence[Array]) -> dict[str, Array]:
    """Return each layer's inputs, one input vector per row, by its matrix's name (`export.program.controller_program`).
    "decoder.blocks.0.elu" and so on are the outputs of the ELUs in the decoder's blocks. The rows of dynamics and
    decoder cover all steps of all roll-outs. `windows` are (L, S+1). Raises ExportError if there are none."""
    if not windows:
        raise ExportError("int8 calibration: there are no windows from which to measure activations")
    encoder = encoder_layers(program, np.array(windows))
    plans = _plans(program, np.random.default_rng(0))
    # Every latent state is combined with every plan; the rows of one time step are adjacent.
    z = np.repeat(linear(program.encoder.output, encoder.latent), len(plans), axis=0)
    actions = np.tile(plans, (len(windows), 1))
    latents = np.moveaxis(rollout(program, z, actions), 1, 0)
    first, second = dynamics_layers(program, _rows(latents[:-1]), actions.T.ravel())
    blocks, forces = decoder_layers(program, _rows(latents[1:]))
    return {
        "lstm.weight_input": _rows(np.moveaxis(encoder.rows, 1, 0)),
        "lstm.weight_recurrent": _rows(np.moveaxis(encoder.recurrent, 1, 0)),
        "encoder.hidden.weight": encoder.head,
        "encoder.output.weight": encoder.latent,
        "dynamics.input.weight": first.x,
        "dynamics.hidden.weight": second.x,
        "dynamics.output.weight": second.elu,
        "decoder.input.weight": _rows(latents[1:]),
        **{f"decoder.blocks.{i}.linear.weight": block.x for i, block in enumerate(blocks)},
        **{f"decoder.blocks.{i}.elu": block.elu for i, block in enumerate(blocks)},
        "decoder.output.weight": forces,
        **({} if program.prior is None else _of_prior(program.prior, windows)),
    }


def _of_prior(prior: PriorWeights, windows: Sequence[Array]) -> dict[str, Array]:
    past = [prior.filters.T @ past_of(window, prior.memory)[0] for window in windows]
    sums = [filtered_sums(prior, window) for window in windows]
    named = {"prior.first": past, "prior.sums": sums}
    return {name: np.array(rows).reshape(len(windows), -1) for name, rows in named.items()}


def _plans(program: ControllerProgram, rng: np.random.Generator) -> Array:
    h, limit = program.mpc.horizon, program.action_limit
    wandering = np.cumsum(_STRIDE * limit * rng.standard_normal((_WANDERING, h)), axis=1)
    constant = (np.zeros(h), np.full(h, limit), np.full(h, -limit))
    return np.array([*constant, *rng.uniform(-limit, limit, (_RANDOM, h)), *np.clip(wandering, -limit, limit)])


def _rows(values: Array) -> Array:
    return values.reshape(-1, values.shape[-1])
