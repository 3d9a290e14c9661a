"""The force decoder and its adjoint as ONNX nodes, all H steps of the horizon as one batch of rows."""

from dataclasses import dataclass

from export.program.controller_program import ControllerProgram
from export.program.weights import ResidualBlock
from export.to_onnx.graph_builder import Graph
from export.to_onnx.weights import NormNames, Store, centred, centred_bias, transposed


@dataclass(frozen=True, kw_only=True)
class BlockTape:
    """What a residual block's adjoint needs: xhat, and p = ELU' g r (see `to_onnx.dynamics`), both (H, width)."""

    xhat: str
    slope: str


class Decoder:
    """f_dec in a graph, with matrices prepared once."""

    def __init__(self, graph: Graph, program: ControllerProgram, store: Store) -> None:
        weights, scaling = program.decoder, program.scaling
        self._input = store(graph, "decoder.input.weight")
        self._input_bias = graph.constant(weights.input.bias, "decoder.input.bias")
        self._blocks = [_Block(graph, block, i, store) for i, block in enumerate(weights.blocks)]
        self._output = store(graph, "decoder.output.weight")
        self._output_bias = graph.constant(weights.output.bias, "decoder.output.bias")
        self._force_mean = graph.constant(scaling.force_mean, "force_mean")
        self._force_std = graph.constant(scaling.force_std, "force_std")

    def forward(self, graph: Graph, latents: str) -> tuple[str, list[BlockTape]]:
        """Physical (Cd, Cl), (H, 2), from latents (H, n_z), and the tape for `adjoint`."""
        x = graph.op("Gemm", latents, self._input, self._input_bias, transB=1)
        tapes = []
        for block in self._blocks:
            x, tape = block.forward(graph, x)
            tapes.append(tape)
        scaled = graph.op("Gemm", x, self._output, self._output_bias, transB=1)
        return graph.op("Add", graph.op("Mul", scaled, self._force_std), self._force_mean), tapes

    def adjoint(self, graph: Graph, tapes: list[BlockTape], d_forces: str) -> str:
        """dJ/dz (H, n_z) from dJ/d(Cd, Cl) (H, 2)."""
        d = graph.op("MatMul", graph.op("Mul", d_forces, self._force_std), self._output)
        for block, tape in zip(reversed(self._blocks), reversed(tapes), strict=True):
            d = block.adjoint(graph, tape, d)
        return graph.op("MatMul", d, self._input)


class _Block:
    def __init__(self, graph: Graph, block: ResidualBlock, number: int, store: Store) -> None:
        name = f"decoder.blocks.{number}"
        self._backward = centred(graph, store(graph, f"{name}.linear.weight"))
        self._forward = transposed(graph, self._backward)
        self._bias = graph.constant(centred_bias(block.linear.bias), f"{name}.linear.bias")
        self._norm = NormNames(graph, block.norm, f"{name}.norm")
        self._zero, self._one = graph.constant(0.0), graph.constant(1.0)

    def forward(self, graph: Graph, x: str) -> tuple[str, BlockTape]:
        xhat, inverse_std = self._norm.normalise(graph, graph.op("Gemm", x, self._forward, self._bias))
        y = graph.op("Add", graph.op("Mul", xhat, self._norm.gain), self._norm.offset)
        # ELU as max(y, 0) + exp(min(y, 0)) - 1: the exponential is its slope, and faster than the Elu operator
        # on a whole horizon.
        slope = graph.op("Exp", graph.op("Min", y, self._zero))
        elu = graph.op("Add", graph.op("Relu", y), graph.op("Sub", slope, self._one))
        factor = graph.op("Mul", graph.op("Mul", slope, self._norm.gain), inverse_std)
        return graph.op("Add", x, elu), BlockTape(xhat=xhat, slope=factor)

    def adjoint(self, graph: Graph, tape: BlockTape, d: str) -> str:
        t = graph.op("Mul", d, tape.slope)
        along = graph.op("ReduceMean", graph.op("Mul", t, tape.xhat), graph.index([1]), keepdims=1)
        v = graph.op("Sub", t, graph.op("Mul", tape.xhat, along))
        return graph.op("Add", d, graph.op("MatMul", v, self._backward))
