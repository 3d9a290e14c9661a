"""An LSTM over many overlapping windows that computes their shared parts only once.

Consecutive windows of L rows overlap in all rows but one. So the windows' input projections W_ih x_k + b are computed
once per row. Only the recurrence, which starts from zero in every window, runs for each window. Equations, gate order
(i, f, g, o) and layout of the weights are as in `torch.nn.LSTM`. With the projected row p they are

    (i, f, o) = sigmoid(p + W_hh h),  g = tanh(p + W_hh h),  c' = f c + i g,  h' = o tanh(c')

The backward pass does not use PyTorch's autograd: it adds each window's gradient in place to the row that the gradient
belongs to. Autograd would build and traverse a graph of some 400 small nodes. The arrays here have gates as rows and
windows as columns, so that each gate and each sequence of windows is contiguous in memory.
"""

from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable


def last_hidden(
    segments: Tensor, window: int, weight_ih: Tensor, weight_hh: Tensor, bias_ih: Tensor, bias_hh: Tensor
) -> Tensor:
    """Compute the LSTM's final hidden state for every window of L rows. The S segments (S, R, F) have R >= L
    consecutive rows of F features. Returns (S, R - L + 1, H): entry w of a segment is the state after rows w .. w+L-1,
    starting from zero. `weight_ih` is (4H, F), `weight_hh` (4H, H) and each bias (4H,), as in `torch.nn.LSTM`."""
    count, rows, features = segments.shape
    flat = segments.transpose(0, 1).reshape(rows * count, features)
    projected = torch.addmm((bias_ih + bias_hh)[:, None], weight_ih, flat.T).view(-1, rows, count)
    if torch.is_grad_enabled() and (projected.requires_grad or weight_hh.requires_grad):
        hidden: Tensor = _Recurrence.apply(projected, weight_hh, window)  # type: ignore[no-untyped-call]  # torch's own
    else:
        hidden = _forward(projected, weight_hh, window, keep=False)[2][0]
    return hidden.view(-1, rows - window + 1, count).permute(2, 1, 0)


class _Recurrence(torch.autograd.Function):
    """The recurrence and its backward pass. Projected rows (4H, R, S) and recurrent weights (4H, H) give final hidden
    states (H, W S), with W = R - L + 1."""

    @staticmethod
    def forward(ctx: Any, projected: Tensor, weight: Tensor, window: int) -> Tensor:
        gates, cells, hidden, squashed = _forward(projected, weight, window, keep=True)
        ctx.save_for_backward(weight, gates, cells, hidden, squashed)
        ctx.shape = projected.shape
        return hidden[-1].clone()

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, grad: Tensor) -> tuple[Tensor, Tensor | None, None]:
        weight, gates, cells, hidden, squashed = ctx.saved_tensors
        (_, rows, count), (width, size) = ctx.shape, grad.shape
        sigmoid_backward = torch.ops.aten.sigmoid_backward.grad_input
        tanh_backward = torch.ops.aten.tanh_backward.grad_input
        d_rows = grad.new_zeros(4 * width, rows * count)
        d_weight = torch.zeros_like(weight) if ctx.needs_input_grad[1] else None
        d_hidden, d_cell = grad.contiguous(), torch.zeros_like(grad, memory_format=torch.contiguous_format)
        d_gates, scratch = grad.new_empty(4 * width, size), torch.empty_like(d_cell)
        for step in reversed(range(len(gates))):
            i, f, g, o = gates[step].view(4, width, size)
            d_i, d_f, d_g, d_o = d_gates.view(4, width, size)
            tanh_c = squashed[step]
            torch.mul(d_hidden, tanh_c, out=d_o)
            # The lines below compute `dL/dc' += dL/dh' * o * (1 - tanh(c')^2)`.
            torch.mul(d_hidden, o, out=scratch)
            d_cell.add_(scratch).addcmul_(scratch.mul_(tanh_c), tanh_c, value=-1.0)
            torch.mul(d_cell, g, out=d_i)
            torch.mul(d_cell, cells[step], out=d_f)
            torch.mul(d_cell, i, out=d_g)
            d_cell.mul_(f)
            sigmoid_backward(d_gates[: 2 * width], gates[step, : 2 * width], grad_input=d_gates[: 2 * width])
            tanh_backward(d_g, g, grad_input=d_g)
            sigmoid_backward(d_o, o, grad_input=d_o)
            d_rows[:, step * count : step * count + size] += d_gates
            if d_weight is not None:
                d_weight.addmm_(d_gates, hidden[step].T)
            if step:
                d_hidden = torch.mm(weight.T, d_gates)
        return d_rows.view(4 * width, rows, count), d_weight, None


def _forward(projected: Tensor, weight: Tensor, window: int, *, keep: bool) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Return gates (L, 4H, N), cells (L + 1, H, N), hidden states (L + 1, H, N) and tanh(c) (L, H, N) of every step for
    N = W S windows, or only the last step's values if `keep` is False."""
    (gate_rows, rows, count), width = projected.shape, weight.shape[1]
    size = (rows - window + 1) * count
    flat = projected.reshape(gate_rows, rows * count)
    kept = window if keep else 1
    gates, squashed = flat.new_empty(kept, gate_rows, size), flat.new_empty(kept, width, size)
    cells, hidden = flat.new_zeros(2, kept + keep, width, size)
    for step in range(window):
        now, new = (step, step + 1) if keep else (0, 0)
        gate = gates[now]
        torch.addmm(flat[:, step * count : step * count + size], weight, hidden[now], out=gate)
        gate[: 2 * width].sigmoid_()
        gate[2 * width : 3 * width].tanh_()
        gate[3 * width :].sigmoid_()
        i, f, g, o = gate.view(4, width, size)
        torch.mul(f, cells[now], out=cells[new])
        cells[new].addcmul_(i, g)
        torch.tanh(cells[new], out=squashed[now])
        torch.mul(o, squashed[now], out=hidden[new])
    return gates, cells, hidden, squashed
