"""The force decoder and its adjoint as ONNX nodes; all H steps of the horizon are one batch of rows.

The forces' scaling is folded into the last matrix and bias. In a block, ELU(y) = max(y, 0) + exp(min(y, 0)) - 1. The
term -1 is left out of the rows that pass from block to block; the biases of the following layers compensate for this.
"""

import numpy as np

from contract.arrays import Array
from export.program.controller_program import ControllerProgram
from export.program.weights import Linear, ResidualWeights
from export.to_onnx.graph_builder import Graph, NormNames, PutMatrix, centred, centred_bias, transposed

BlockTape = tuple[str, str]
"""The values that a residual block's adjoint needs: xhat and p = ELU' g r (see `to_onnx.dynamics`), each (H, width)."""


class DecoderGraph:
    """The decoder f_dec in a graph; its matrices are prepared once."""

    def __init__(self, graph: Graph, program: ControllerProgram, store: PutMatrix) -> None:
        weights, scaling = program.decoder, program.scaling
        self._input = store(graph, "decoder.input.weight")
        self._input_bias = graph.constant(weights.input.bias, "decoder.input.bias")
        self._blocks = [_Block(graph, block, i, store) for i, block in enumerate(weights.blocks)]
        force_std = graph.constant(np.array(scaling.force_std)[:, None], "force_std")
        self._output = graph.op("Mul", store(graph, "decoder.output.weight"), force_std)
        cd, cl = graph.ops("Split", self._output, graph.index([1, 1]), outputs=2, axis=0)
        minus_cd = graph.op("Mul", cd, graph.constant(-1.0))
        self._signed_output = graph.op("Concat", cd, minus_cd, cl, axis=0)
        bias, taped_bias = (
            _without_ones(weights.output, ones) * np.array(scaling.force_std) + np.array(scaling.force_mean)
            for ones in (0, len(weights.blocks))
        )
        self._output_bias = graph.constant(bias, "decoder.output.bias")
        self._signed_output_bias = graph.constant(taped_bias[[0, 0, 1]] * [1.0, -1.0, 1.0], "decoder.output.bias")

    def forces(self, graph: Graph, latents: str) -> str:
        """Add nodes that compute the physical (Cd, Cl), (H, 2), from latents (H, n_z)."""
        x = graph.op("Gemm", latents, self._input, self._input_bias, transB=1)
        for block in self._blocks:
            x = block.plain(graph, x)
        return graph.op("Gemm", x, self._output, self._output_bias, transB=1)

    def signed_forces(self, graph: Graph, latents: str) -> tuple[str, list[BlockTape]]:
        """Add nodes that compute (Cd, -Cd, Cl), (H, 3), for `Cost.gradient`, and the tape for `adjoint`."""
        x = graph.op("Gemm", latents, self._input, self._input_bias, transB=1)
        tapes = []
        for block in self._blocks:
            x, tape = block.taped(graph, x)
            tapes.append(tape)
        return graph.op("Gemm", x, self._signed_output, self._signed_output_bias, transB=1), tapes

    def adjoint(self, graph: Graph, tapes: list[BlockTape], d_signed_forces: str) -> str:
        """Add nodes that compute dJ/dz (H, n_z) from dJ/d(Cd, -Cd, Cl) (H, 3)."""
        d = graph.op("MatMul", d_signed_forces, self._signed_output)
        for block, tape in zip(reversed(self._blocks), reversed(tapes), strict=True):
            d = block.adjoint(graph, tape, d)
        return graph.op("MatMul", d, self._input)


class _Block:
    def __init__(self, graph: Graph, block: ResidualWeights, number: int, store: PutMatrix) -> None:
        name = f"decoder.blocks.{number}"
        self._backward = centred(graph, store(graph, f"{name}.linear.weight"))
        self._forward = transposed(graph, self._backward)
        self._bias = graph.constant(centred_bias(block.linear.bias), f"{name}.linear.bias")
        self._taped_bias = graph.constant(centred_bias(_without_ones(block.linear, number)), f"{name}.linear.bias")
        self._norm = NormNames(graph, block.norm, f"{name}.norm")
        self._zero = graph.constant(0.0)

    def plain(self, graph: Graph, x: str) -> str:
        """Add nodes that compute the block's output (H, width)."""
        y = self._norm.apply(graph, graph.op("Gemm", x, self._forward, self._bias))
        return graph.op("Add", x, graph.op("Elu", y))

    def taped(self, graph: Graph, x: str) -> tuple[str, BlockTape]:
        """Add nodes that compute the values for the adjoint, and the block's output. The output is too high by the
        number of blocks up to and including this block, because each block leaves out its term -1."""
        u = graph.op("Gemm", x, self._forward, self._taped_bias)
        y, inverse_std = self._norm.with_inverse_std(graph, u)
        slope = graph.op("Exp", graph.op("Min", y, self._zero))
        above = graph.op("Add", graph.op("Add", x, graph.op("Relu", y)), slope)
        factor = graph.op("Mul", graph.op("Mul", slope, self._norm.gain), inverse_std)
        # u has mean zero, because its matrix and bias are centred.
        return above, (graph.op("Mul", u, inverse_std), factor)

    def adjoint(self, graph: Graph, tape: BlockTape, d: str) -> str:
        xhat, slope = tape
        t = graph.op("Mul", d, slope)
        along = graph.op("ReduceMean", graph.op("Mul", t, xhat), graph.index([1]), keepdims=1)
        v = graph.op("Sub", t, graph.op("Mul", xhat, along))
        return graph.op("Gemm", v, self._backward, d)


def _without_ones(layer: Linear, ones: int) -> Array:
    """Return the bias of a layer whose inputs are all too high by `ones`, so that the layer's output is unchanged."""
    return np.asarray(layer.bias - ones * layer.weight.sum(axis=1))
