"""A flow that anyone can check: a growing oscillator whose drag is its energy, differentiated by torch."""

import numpy as np
import torch
from torch import Tensor

from contract.differentiable import FlowState, Seen
from train.refinement.feedback import Feedback

GROWTH, TURN = 1.01, 0.6
"""A period's: the oscillator grows by the first and turns by the second, rad."""
DIFFERENCES = ((1.0, 0.1), (0.0, 1.0))
"""Of Cp at two pairs of sensors, from x."""
MIDDLES = (-0.9, -1.1)
"""Sums of the pairs without motion."""
DRAG = 0.6
"""Without motion."""


class Oscillator:
    """x' = tanh(R x + (0, 4 a)), Cd = 0.6 + x.x, Cl = x_0, Uy = x_1, and Cp at two pairs: differences x_0 + 0.1 x_1 and
    x_1, sums x_0^2 - 0.9 and x_0 x_1 - 1.1."""

    def __init__(self) -> None:
        turn = GROWTH * np.array([[np.cos(TURN), -np.sin(TURN)], [np.sin(TURN), np.cos(TURN)]])
        self._turn = torch.from_numpy(turn)
        self._see, self._middles = (torch.tensor(one, dtype=torch.float64) for one in (DIFFERENCES, MIDDLES))
        self._x = torch.zeros(2, dtype=torch.float64)
        self._bar = torch.zeros(2, dtype=torch.float64)
        self._tape: list[tuple[Tensor, Tensor, Tensor]] = []
        self._action = 0.0

    def begin(self, state: FlowState, speeds: np.ndarray | None = None) -> Seen:
        self._x, self._action, self._tape = torch.from_numpy(state.flat.copy()), state.action, []
        self._bar = torch.zeros(2, dtype=torch.float64)
        return self._seen(self._x)

    def advance(self, action: float) -> Seen:
        before = self._x.clone().requires_grad_(True)
        acted = torch.tensor(action, dtype=torch.float64, requires_grad=True)
        after = torch.tanh(self._turn @ before + torch.stack([torch.zeros_like(acted), 4.0 * acted]))
        self._tape.append((before, acted, after))
        self._x, self._action = after.detach(), action
        return self._seen(self._x)

    def back(self, weights: Seen) -> float:
        before, acted, after = self._tape.pop()
        x = after.detach().requires_grad_(True)
        value = weights.Cd * (x @ x) + weights.Cl * x[0] + weights.Uy * x[1]
        value = value + torch.from_numpy(weights.Cp) @ self._pressures(x)
        (own,) = torch.autograd.grad(value, x)
        self._bar, to_action = torch.autograd.grad(after, (before, acted), own + self._bar)
        return float(to_action)

    def state(self) -> FlowState:
        return FlowState(flat=self._x.numpy().copy(), action=self._action)

    def at_rest(self, state: FlowState, speed: float) -> tuple[float, float] | None:
        del state
        return -0.5 * speed, 0.2 * speed**2

    def _pressures(self, x: Tensor) -> Tensor:
        differences, sums = self._see @ x, self._middles + x[0] * x
        return torch.stack([sums + differences, sums - differences], dim=1).flatten() / 2.0

    def _seen(self, x: Tensor) -> Seen:
        return Seen(Cp=self._pressures(x).numpy(), Cd=DRAG + float(x @ x), Cl=float(x[0]), Uy=float(x[1]))


START = FlowState(flat=np.array([0.3, -0.2]))


def feedback_of(
    memory: int = 6, units: int = 5, *, seed: int = 0, scales: tuple[float, ...] = (0.3, 0.3, 0.05)
) -> Feedback:
    """A feedback for the oscillator's sensors, with weights that a training could have made."""
    made = Feedback(memory, units, scales, MIDDLES, 0.075, seed)
    for number, weights in enumerate(made.parameters()):
        torch.nn.init.normal_(weights, 0.0, 0.3, generator=torch.Generator().manual_seed(10 * seed + number))
    return made
