"""Symmetric int8 weights, one scale per output row; biases, norms and arithmetic stay float.

W[r, c] ~ scale[r] q[r, c] with q in -127 .. 127 and scale[r] = max_c |W[r, c]| / 127, so that the error of a
weight is at most scale / 2 (half a step). This quarters the file; on x86 it does not shorten the step.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from contract.arrays import Array

QMAX: Final = 127
"""Largest magnitude of a quantised weight: -128 is left out, so that negating a row is exact."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Int8Matrix:
    """values (outputs, inputs) int8 and one positive scale per output, float32."""

    values: npt.NDArray[np.int8]
    scales: npt.NDArray[np.float32]

    def dequantised(self) -> npt.NDArray[np.float32]:
        """scale[r] q[r, c], rounded to float32 as ONNX's DequantizeLinear does."""
        return self.values.astype(np.float32) * self.scales[:, None]


def quantise_matrix(weight: Array) -> Int8Matrix:
    """The nearest Int8Matrix of a matrix (outputs, inputs)."""
    scales = row_scales(weight)
    steps = np.rint(weight / scales[:, None].astype(np.float64))
    return Int8Matrix(values=np.clip(steps, -QMAX, QMAX).astype(np.int8), scales=scales)


def row_scales(weight: Array) -> npt.NDArray[np.float32]:
    """The scale of every row: its largest magnitude over 127; a row of zeros takes 1."""
    largest = np.abs(weight).max(axis=1)
    # The floor keeps the scale a normal float32: below it, a row's products vanish in float32 anyway.
    return np.where(largest > 0, np.maximum(largest / QMAX, np.finfo(np.float32).tiny), 1.0).astype(np.float32)
