"""The three networks as ONNX nodes, with the adjoints of dynamics and decoder.

The dynamics are Scans over the horizon: forwards for the states, backwards for the adjoint. ONNX Runtime needs time for
every node, however small. So the Scans have only the recursions, and everything else is computed for all H steps at
once. The forward Scan leaves out the action's part of the first layer, and the last layer's bias b_3. With that layer's
matrix W_3 and input h_k, its recursion is

    s_{k+1} = s_k + W_3 h_k,    z_k = s_k + k b_3.

The backward Scan has three products only. Both layer norms get centred inputs (`centred`). For a norm of gain g, bias
b, width n and normalised input xhat, with r = 1 / std and p = ELU'(g xhat + b) r, the adjoint of norm and ELU is

    v = d diag(g) diag(p) (I - xhat xhat^T / n).

diag(g) is multiplied into the constant matrix to its left. The other factors are multiplied into the neighbouring
matrix that is smaller: W_3 in B, W_1 in A. Let d_k be the sum over all steps from k + 1 on of dJ/dz through the forces
alone. Let e_k be the rest of dJ/dz_{k+1}, which passes through f_dyn of later steps. The Scan then computes

    e_{k-1} = e_k + (e_k + d_k) B_k W_2 diag(g_1) A_k,
    B = W_3 diag(g_2) diag(p_2) (I - xhat_2 xhat_2^T / n),    A = diag(p_1) (I - xhat_1 xhat_1^T / n) W_1.

In the decoder all H steps of the horizon are one batch of rows. The forces' scaling is multiplied into the last
layer. The blocks compute ELU(y) = max(y, 0) + exp(min(y, 0)) - 1 without the term -1; later biases compensate for this.
"""

from dataclasses import dataclass

import numpy as np

from contract.arrays import Array
from export.program.controller_program import ControllerProgram
from export.program.weights import Linear, ResidualWeights
from export.to_onnx.graph_builder import Graph, NormNames, PutMatrix, centred, centred_bias, transposed


def lower_encoder(graph: Graph, program: ControllerProgram, window: str, store: PutMatrix) -> str:
    """Add nodes that compute the latent state z_t as a row (1, n_z), from the window (L, S+1)."""
    weights, scaling = program.encoder, program.scaling
    width = weights.lstm.width
    # PyTorch's gate order is i, f, g, o. ONNX's order is i, o, f, c, where c is PyTorch's g.
    i, f, g, o = np.split(np.arange(4 * width), 4)
    gates = np.concatenate([i, o, f, g])
    mean = graph.constant(scaling.window_mean, "window_mean")
    # With 1 / std, a standard deviation too small for float32 is refused; as a divisor, it would be rounded to zero.
    std = np.array(scaling.window_std)
    rows = window
    if program.encoder_rows < program.window:
        rows = graph.slice(window, program.window - program.encoder_rows, program.window, 0)
    scaled = graph.op("Mul", graph.op("Sub", rows, mean), graph.constant(1.0 / std, "1 / window_std"))

    def linear(x: str, name: str, bias: Array) -> str:
        weight = store(graph, f"encoder.{name}.weight")
        return graph.op("Gemm", x, weight, graph.constant(bias, f"encoder.{name}.bias"), transB=1)

    # The weights' first axis is the direction; the sequence has a batch axis of length one.
    biases = np.concatenate([weights.lstm.bias_input[gates], weights.lstm.bias_recurrent[gates]])
    _, hidden = graph.ops(
        "LSTM",
        graph.op("Unsqueeze", scaled, graph.index([1])),
        store(graph, "lstm.weight_input", rows=gates, leading=1),
        store(graph, "lstm.weight_recurrent", rows=gates, leading=1),
        graph.constant(biases[None], "lstm.bias"),
        outputs=2,
        hidden_size=width,
    )
    row = graph.op("Squeeze", hidden, graph.index([0]))
    normed = NormNames(graph, weights.norm, "encoder.norm").apply(graph, row)
    return linear(graph.op("Elu", linear(normed, "hidden", weights.hidden.bias)), "output", weights.output.bias)


@dataclass(frozen=True, kw_only=True)
class Rollout:
    """The names of a forward pass's tensors in the graph. `latents`: latents at t+1 .. t+H, (H, n_z); `before`: inputs
    of the two norms, (H, 1, width) each; `after`: outputs of the two ELUs, (H, 1, width) each."""

    latents: str
    before: tuple[str, str]
    after: tuple[str, str]


class DynamicsGraph:
    """The dynamics f_dyn in a graph. Its matrices are prepared once, and are used by all roll-outs and adjoints."""

    def __init__(self, graph: Graph, program: ControllerProgram, store: PutMatrix) -> None:
        weights = program.dynamics
        latent = weights.latent
        self._latent, self._horizon = latent, program.mpc.horizon
        first = centred(graph, store(graph, "dynamics.input.weight"))
        second = centred(graph, store(graph, "dynamics.hidden.weight"))
        third = store(graph, "dynamics.output.weight")
        by_state = graph.slice(first, 0, latent, 1)
        by_action = graph.slice(first, latent, latent + 1, 1)
        per_action = graph.constant(1.0 / program.scaling.action_std, "1 / action_std")
        self._by_action_row = transposed(graph, graph.op("Mul", by_action, per_action))
        self._forward = (transposed(graph, by_state), transposed(graph, second))
        self._output = third
        first_bias = graph.constant(centred_bias(weights.input.bias)[None], "dynamics.input.bias")
        self._hidden_bias = graph.constant(centred_bias(weights.hidden.bias)[None], "dynamics.hidden.bias")
        self._output_bias = graph.constant(weights.output.bias[None], "dynamics.output.bias")
        # Row k of the (H, width) bias is for step k: b_1 plus the first layer's product with k * b_3.
        steps = graph.constant(np.arange(self._horizon)[:, None], "steps")
        per_step = graph.op("MatMul", self._output_bias, self._forward[0])
        self._bias_by_step = graph.op("Add", graph.op("Mul", steps, per_step), first_bias)
        norm_in = NormNames(graph, weights.norm_in, "dynamics.norm_in")
        self._norms = norm_in, NormNames(graph, weights.norm_hidden, "dynamics.norm_hidden")
        self._backward = graph.op("Mul", second, self._norms[0].gain)
        self._output_backward = graph.op("Mul", third, self._norms[1].gain)
        # These matrices are transposed and divided by a layer's width n, so that products with them give means.
        self._output_backward_means = _per_width(graph, self._output_backward, self._norms[1])
        self._forward_means = _per_width(graph, self._forward[0], self._norms[0])
        self._column = graph.index([self._horizon, 1])

    def rollout(self, graph: Graph, z: str, plan: str) -> Rollout:
        """Add nodes that compute the latent states with a plan (1, H) in U_inf W, starting from z (1, n_z)."""
        actions = graph.op("Reshape", plan, self._column)
        drive = graph.op("Gemm", actions, self._by_action_row, self._bias_by_step)

        body = graph.body()
        widths = [norm.width for norm in self._norms]
        state = body.input("s", (1, self._latent))
        driven = body.input("drive", (widths[0],))
        u1 = body.op("Gemm", state, self._forward[0], driven)
        h1 = body.op("Elu", self._norms[0].apply(body, u1))
        u2 = body.op("Gemm", h1, self._forward[1], self._hidden_bias)
        h2 = body.op("Elu", self._norms[1].apply(body, u2))
        body.output(body.op("Gemm", h2, self._output, state, transB=1), (1, self._latent))
        for value, width in ((u1, widths[0]), (h1, widths[0]), (u2, widths[1]), (h2, widths[1])):
            body.output(value, (1, width))

        _, u1s, h1s, u2s, h2s = graph.scan(body, states=[z], sequences=[drive])
        rows = graph.op("Reshape", h2s, graph.index([self._horizon, widths[1]]))
        changes = graph.op("Gemm", rows, self._output, self._output_bias, transB=1)
        latents = graph.op("Add", graph.op("CumSum", changes, graph.index([0])), z)
        return Rollout(latents=latents, before=(u1s, u2s), after=(h1s, h2s))

    def adjoint(self, graph: Graph, rollout: Rollout, through_forces: str, through_plan: str) -> str:
        """Add nodes that compute dJ/da (1, H) from dJ/dz (H, n_z) through the forces, and dJ/da at fixed forces."""
        h, widths = self._horizon, [norm.width for norm in self._norms]
        xhat1, p1 = self._linearise(graph, 0, rollout)
        xhat2, p2 = self._linearise(graph, 1, rollout)
        # These nodes compute B_k and the transposed A_k of all steps, (H, n_z, width), and d_k B_k.
        w3_p2_xhat2 = self._products(graph, graph.op("Mul", p2, xhat2), self._output_backward_means)
        b = graph.op("Sub", graph.op("Mul", p2, self._output_backward), graph.op("Mul", w3_p2_xhat2, xhat2))
        w1_xhat1 = self._products(graph, xhat1, self._forward_means)
        a = graph.op("Mul", graph.op("Sub", self._forward[0], graph.op("Mul", w1_xhat1, xhat1)), p1)
        d = graph.op("CumSum", through_forces, graph.index([0]), reverse=1)
        d_b = graph.op("MatMul", graph.op("Unsqueeze", d, graph.index([1])), b)

        body = graph.body()
        e_k, d_b_k = body.input("later", (1, self._latent)), body.input("direct", (1, widths[1]))
        b_k, a_k = body.input("into", (self._latent, widths[1])), body.input("out", (self._latent, widths[0]))
        d1 = body.op("MatMul", body.op("Gemm", e_k, b_k, d_b_k), self._backward)
        body.output(body.op("Gemm", d1, a_k, e_k, transB=1), (1, self._latent))
        body.output(d1, (1, widths[0]))

        zero = graph.constant([[0.0] * self._latent])
        _, d1s = graph.scan(body, states=[zero], sequences=[d_b, b, a], reverse=True)
        # The gradient dJ/da_k is the dot product of v, the first layer's adjoint, with the action's column of W_1.
        t = graph.op("Mul", d1s, p1)
        t_xhat1 = graph.op("ReduceMean", graph.op("Mul", t, xhat1), graph.index([2]), keepdims=1)
        v = graph.op("Sub", t, graph.op("Mul", t_xhat1, xhat1))
        rows = graph.op("Reshape", v, graph.index([h, widths[0]]))
        return graph.op("Gemm", self._by_action_row, rows, through_plan, transB=1)

    def _products(self, graph: Graph, rows: str, columns: str) -> str:
        """Multiply H rows (H, 1, n) by a matrix (n, n_z); the result is (H, n_z, 1)."""
        return graph.op("Reshape", graph.op("MatMul", rows, columns), graph.index([self._horizon, self._latent, 1]))

    def _linearise(self, graph: Graph, layer: int, rollout: Rollout) -> tuple[str, str]:
        xhat, inverse_std = self._norms[layer].normalise(graph, rollout.before[layer])
        # The slope ELU' follows from the output of ELU: it is 1 if the output is positive, otherwise the output plus 1.
        zero, one = graph.constant(0.0), graph.constant(1.0)
        slope = graph.op("Add", graph.op("Min", rollout.after[layer], zero), one)
        return xhat, graph.op("Mul", slope, inverse_std)


def _per_width(graph: Graph, matrix: str, norm: NormNames) -> str:
    return transposed(graph, graph.op("Mul", matrix, graph.constant(1.0 / norm.width)))


BlockTape = tuple[str, str]
"""The values that a residual block's adjoint needs: xhat, and the product of ELU', gain and r, each (H, width)."""


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
    """Return a layer's bias for inputs that are all too high by `ones`; the layer's output stays the same."""
    return np.asarray(layer.bias - ones * layer.weight.sum(axis=1))
