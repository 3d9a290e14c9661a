"""The weights of the three networks as float64 arrays (paper, table 1), and the checks of the tensors that are read.

Matrices are (outputs, inputs), as PyTorch stores them. Widths, window and number of decoder blocks follow from the
arrays' shapes. Each `from_state` reads tensors by the names of a network's state dict, and raises ExportError, with the
tensor's name, if a tensor is missing, unknown, not finite or of the wrong shape.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from contract.arrays import Array
from contract.controller.goal import SCHEDULED, SPEED_PLACES, SPEED_SCALE, of_two_speeds
from contract.controller.interface import FORCES
from contract.errors import ExportError

StateDict = Mapping[str, npt.NDArray[Any]]
"""Tensors by name, as in a PyTorch state dict."""
LAYER_NORM_EPSILON: Final = 1e-5
"""Number added to the variance in every layer norm; PyTorch's default."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Linear:
    """A linear layer y = W x + b, with W (outputs, inputs) and b (outputs,)."""

    weight: Array
    bias: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Norm:
    """The gain and offset of a layer norm, both (width,)."""

    weight: Array
    bias: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Lstm:
    """An LSTM of width h with S + 1 inputs: weights (4h, S+1) and (4h, h), biases (4h,), gates i, f, g, o."""

    weight_input: Array
    weight_recurrent: Array
    bias_input: Array
    bias_recurrent: Array

    @property
    def width(self) -> int:
        """h, the size of the hidden state."""
        return int(self.weight_recurrent.shape[1])


@dataclass(frozen=True, kw_only=True, eq=False)
class EncoderWeights:
    """The encoder: an LSTM, a layer norm of its last hidden state, then two linear layers with an ELU between them."""

    lstm: Lstm
    norm: Norm
    hidden: Linear
    output: Linear

    @classmethod
    def from_state(cls, state: StateDict) -> "EncoderWeights":
        tensors = _Tensors("encoder", state)
        width = tensors.size("lstm.weight_hh_l0", axis=1)
        inputs = tensors.size("lstm.weight_ih_l0", axis=1)
        weights = cls(
            lstm=Lstm(
                weight_input=tensors.take("lstm.weight_ih_l0", (4 * width, inputs)),
                weight_recurrent=tensors.take("lstm.weight_hh_l0", (4 * width, width)),
                bias_input=tensors.take("lstm.bias_ih_l0", (4 * width,)),
                bias_recurrent=tensors.take("lstm.bias_hh_l0", (4 * width,)),
            ),
            norm=tensors.norm("norm", width),
            hidden=tensors.linear("hidden", width),
            output=tensors.linear("output", tensors.size("hidden.weight", axis=0)),
        )
        tensors.refuse_leftovers()
        return weights

    @property
    def inputs(self) -> int:
        """S + 1, the number of inputs of a row: the S sensors and the action."""
        return int(self.lstm.weight_input.shape[1])

    @property
    def latent(self) -> int:
        return int(self.output.weight.shape[0])


@dataclass(frozen=True, kw_only=True, eq=False)
class DynamicsWeights:
    """The dynamics f(z, a) of latent state z and action a: three linear layers, with layer norm and ELU after the first
    two layers. The input is [z, a / action_std]."""

    input: Linear
    norm_in: Norm
    hidden: Linear
    norm_hidden: Norm
    output: Linear

    @classmethod
    def from_state(cls, state: StateDict) -> "DynamicsWeights":
        tensors = _Tensors("dynamics", state)
        latent, first, second = (tensors.size(f"{name}.weight", axis=0) for name in ("output", "input", "hidden"))
        weights = cls(
            input=tensors.linear("input", latent + 1),
            norm_in=tensors.norm("norm_in", first),
            hidden=tensors.linear("hidden", first),
            norm_hidden=tensors.norm("norm_hidden", second),
            output=tensors.linear("output", second),
        )
        tensors.refuse_leftovers()
        return weights

    @property
    def latent(self) -> int:
        return int(self.output.weight.shape[0])


@dataclass(frozen=True, kw_only=True, eq=False)
class ResidualWeights:
    """A residual block x + ELU(LayerNorm(W x + b)); dropout is inactive at inference."""

    linear: Linear
    norm: Norm


@dataclass(frozen=True, kw_only=True, eq=False)
class DecoderWeights:
    """The decoder: a linear layer, residual blocks, and a linear layer whose outputs are the scaled forces."""

    input: Linear
    blocks: tuple[ResidualWeights, ...]
    output: Linear

    @classmethod
    def from_state(cls, state: StateDict) -> "DecoderWeights":
        tensors = _Tensors("decoder", state)
        width, latent = tensors.shape("input.weight", 2)
        count = len({name.split(".")[1] for name in state if name.startswith("blocks.")})
        weights = cls(
            input=tensors.linear("input", latent),
            blocks=tuple(
                ResidualWeights(
                    linear=tensors.linear(f"blocks.{i}.linear", width, width),
                    norm=tensors.norm(f"blocks.{i}.norm", width),
                )
                for i in range(count)
            ),
            output=tensors.linear("output", width, FORCES),
        )
        tensors.refuse_leftovers()
        return weights

    @property
    def latent(self) -> int:
        return int(self.input.weight.shape[1])


@dataclass(frozen=True, kw_only=True, eq=False)
class PriorWeights:
    """The prior of the plan (`export.reference.prior`): a feedback on M past rows, and a predictor of the next row.

    A row is (y, a): the differences of Cp in each of the p sensor pairs, first sensor minus second, and the action in
    U_inf W. No layer on rows has a bias, so if the pairs are mirror images, a mirrored wake gets the mirrored plan.

    Attributes:
        filters: (M, F) weights of the rows in F filters, oldest row first; the n units read the F filtered rows.
        first: (6, n, F, p + 1) weights of each unit on the filtered rows, for each of the 6 variables in
            `contract.controller.goal.SCHEDULED`.
        gate, sums: (n, 6) and (n, F, p) weights of each unit's gate on these variables and on the filtered sums of Cp.
        output: (n,) weights with which the gated units are summed.
        predictor: (p, M, p + 1) weights that predict the next differences from the M rows up to the present row.
    """

    filters: Array
    first: Array
    gate: Array
    sums: Array
    output: Array
    predictor: Array

    @classmethod
    def from_state(cls, state: StateDict) -> "PriorWeights":
        """Read a state dict, also of an older model. If a model has a single speed variable, this variable's
        weights are used for both speed variables. In a model of version 1.0.0, the plan does not depend on the goal.
        Its tensors are "first" and "slope", both (n, F, p + 1), where "slope" is the change of "first" if the speed
        rises by the design speed; or "hidden", (n, M, p + 1), replaces filters, first and slope."""
        tensors, is_dense = _Tensors("prior", state), "hidden" in state
        if is_dense or "slope" in state:
            name = "hidden" if is_dense else "first"
            units, count, columns = shape = tensors.shape(name, 3)
            slope = np.zeros(shape) if is_dense else SPEED_SCALE * tensors.take("slope", shape)
            first = np.zeros((len(SCHEDULED), *shape))
            first[0], first[list(SPEED_PLACES)] = tensors.take(name, shape), slope
            gate, sums = np.zeros((units, len(SCHEDULED))), np.zeros((units, count, columns - 1))
        else:
            scheduled, units, count, columns = tensors.shape("first", 4)
            if scheduled not in (len(SCHEDULED), len(SCHEDULED) - 1):
                names = ", ".join(SCHEDULED)
                raise ExportError(f"prior.first: has {scheduled} variables, but must have {len(SCHEDULED)}: {names}")
            first = of_two_speeds(tensors.take("first", (scheduled, units, count, columns)))
            gate = of_two_speeds(tensors.take("gate", (units, scheduled)).T).T
            sums = tensors.take("sums", (units, count, columns - 1))
        memory = count if is_dense else tensors.size("filters", axis=0)
        weights = cls(
            filters=np.eye(count) if is_dense else tensors.take("filters", (memory, count)),
            first=first,
            gate=gate,
            sums=sums,
            output=tensors.take("output", (units,)),
            predictor=tensors.take("predictor", (columns - 1, memory, columns)),
        )
        tensors.refuse_leftovers()
        return weights

    @property
    def memory(self) -> int:
        """M, the number of past rows."""
        return len(self.filters)

    @property
    def pairs(self) -> int:
        """p, the number of sensor pairs. A row has one difference for each pair."""
        return int(self.first.shape[3]) - 1

    @property
    def knows_speed(self) -> bool:
        """Whether plans depend on the vehicle's speed."""
        return self._knows("slower", "faster")

    @property
    def knows_goal(self) -> bool:
        """Whether plans depend on the weights of effort and lift in the cost."""
        return self._knows("effort", "lift")

    def _knows(self, *names: str) -> bool:
        places = [SCHEDULED.index(name) for name in names]
        return bool(self.first[places].any() or self.gate[:, places].any())


class _Tensors:
    """A reader of a network's tensors. It checks each tensor, and records which were not read."""

    def __init__(self, network: str, state: StateDict) -> None:
        self._network = network
        self._state = state
        self._left = set(state)

    def size(self, name: str, *, axis: int) -> int:
        return self.shape(name, 2)[axis]

    def shape(self, name: str, axes: int) -> tuple[int, ...]:
        shape = self._find(name).shape
        if len(shape) != axes or 0 in shape:
            raise ExportError(f"{self._network}.{name}: has shape {shape}, but needs {axes} axes of non-zero length")
        return tuple(map(int, shape))

    def take(self, name: str, shape: tuple[int, ...]) -> Array:
        array = np.array(self._find(name), dtype=np.float64)
        if array.shape != shape:
            raise ExportError(f"{self._network}.{name}: has shape {array.shape}, but must have {shape}")
        if not np.isfinite(array).all():
            where = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
            raise ExportError(f"{self._network}.{name}: is {array[where]} at {where}, but must be finite")
        array.flags.writeable = False
        self._left.discard(name)
        return array

    def linear(self, name: str, inputs: int, outputs: int | None = None) -> Linear:
        """Read a linear layer. If `outputs` is not given, the weight's shape determines it."""
        outputs = self.size(f"{name}.weight", axis=0) if outputs is None else outputs
        return Linear(weight=self.take(f"{name}.weight", (outputs, inputs)), bias=self.take(f"{name}.bias", (outputs,)))

    def norm(self, name: str, width: int) -> Norm:
        return Norm(weight=self.take(f"{name}.weight", (width,)), bias=self.take(f"{name}.bias", (width,)))

    def refuse_leftovers(self) -> None:
        if self._left:
            raise ExportError(f"{self._network}.{min(self._left)}: unknown tensor, which this version cannot export")

    def _find(self, name: str) -> npt.NDArray[Any]:
        if name not in self._state:
            raise ExportError(f"{self._network}.{name}: tensor is missing")
        return self._state[name]


def as_float32(values: npt.ArrayLike, name: str) -> npt.NDArray[np.float32]:
    """Round values to float32, as every lowering does. Raises ExportError, with the name, if one is not finite."""
    with np.errstate(over="ignore"):
        array = np.asarray(values, dtype=np.float64).astype(np.float32)
    if not np.isfinite(array).all():
        raise ExportError(f"{name}: a value is too large for float32")
    return array


def float32_within(limit: float) -> float:
    """Return the largest float32 that is not above the limit, so that rounding moves no action out of bounds."""
    rounded = np.float32(limit)
    return float(np.nextafter(rounded, np.float32(0.0)) if float(rounded) > limit else rounded)
