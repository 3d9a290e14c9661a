"""The paper's control method in eager PyTorch: modules, autograd, torch.optim.Adam, clamp.

PyTorch supplies gates, norms, derivatives and optimiser, so this implementation shares no formula with the project's
reference implementation. The parity tests compare the project's implementations with this one, and the benchmark gives
all times relative to this one.
"""

import numpy as np
import torch
from torch import Tensor, nn

from contract.arrays import Array
from contract.controller.goal import DEAREST_EFFORT, DEAREST_LIFT
from export.program.controller_program import ControllerProgram
from export.program.weights import Linear, Norm


class EagerController:
    """The control step of `controller.onnx` in PyTorch, with derivatives by autograd, in a chosen precision."""

    def __init__(self, program: ControllerProgram, dtype: torch.dtype) -> None:
        self._program = program
        self._dtype = dtype
        encoder, dynamics, decoder = program.encoder, program.dynamics, program.decoder
        self._lstm = nn.LSTM(encoder.inputs, encoder.lstm.width, batch_first=True, dtype=dtype)
        self._lstm.load_state_dict(
            {
                "weight_ih_l0": self._tensor(encoder.lstm.weight_input),
                "weight_hh_l0": self._tensor(encoder.lstm.weight_recurrent),
                "bias_ih_l0": self._tensor(encoder.lstm.bias_input),
                "bias_hh_l0": self._tensor(encoder.lstm.bias_recurrent),
            }
        )
        self._encoder_head = nn.Sequential(
            self._norm(encoder.norm), self._linear(encoder.hidden), nn.ELU(), self._linear(encoder.output)
        )
        self._dynamics = nn.Sequential(
            self._linear(dynamics.input), self._norm(dynamics.norm_in), nn.ELU(),
            self._linear(dynamics.hidden), self._norm(dynamics.norm_hidden), nn.ELU(),
            self._linear(dynamics.output),
        )  # fmt: skip
        self._decoder_input = self._linear(decoder.input)
        self._blocks = [
            nn.Sequential(self._linear(block.linear), self._norm(block.norm), nn.ELU()) for block in decoder.blocks
        ]
        self._decoder_output = self._linear(decoder.output)
        heads = (self._lstm, self._encoder_head, self._dynamics, self._decoder_input, self._decoder_output)
        for module in (*heads, *self._blocks):
            module.requires_grad_(False)
        self._force_mean = self._tensor(program.scaling.force_mean)
        self._force_std = self._tensor(program.scaling.force_std)

    def encode(self, window: Array) -> Tensor:
        """Return the latent state, shape (n_z,). `window`, (L, S+1), has L rows with S sensors and the action."""
        scaling = self._program.scaling
        mean, std = self._tensor(scaling.window_mean), self._tensor(scaling.window_std)
        rows = self._tensor(window)[-self._program.encoder_rows :]
        _, (hidden, _) = self._lstm(((rows - mean) / std)[None])
        z: Tensor = self._encoder_head(hidden[-1, 0])
        return z

    def predict(self, z: Tensor, plan: Tensor) -> Tensor:
        """Return the forces over the horizon of H periods, shape (H, 2), under a plan, shape (H,)."""
        latents = []
        for a in plan / self._program.scaling.action_std:
            z = z + self._dynamics(torch.cat([z, a[None]]))
            latents.append(z)
        x = self._decoder_input(torch.stack(latents))
        for block in self._blocks:
            x = x + block(x)
        forces: Tensor = self._decoder_output(x) * self._force_std + self._force_mean
        return forces

    def start(self, window: Array, committed: Tensor, chosen: Tensor, w: Tensor, speed: float, limit: float) -> Tensor:
        """Return the optimiser's initial plan for H periods, shape (H,). The prior computes this plan from two matrix
        products with the flattened past."""
        prior = self._program.prior
        if prior is None:
            return committed
        values, memory = self._tensor(window), prior.memory
        pairs = values[:, :-1].reshape(len(values), -1, 2).diff(dim=2).squeeze(2).neg()
        sums = values[-memory:, :-1].unfold(1, 2, 2).sum(dim=2)
        actions, plan = values[:, -1].roll(-1), list[Tensor]()
        rows = torch.column_stack([pairs, actions])[-memory:]
        filters, output, predictor = map(self._tensor, (prior.filters, prior.output, prior.predictor))
        # The goal has three inputs. The first two are square roots of the weights on effort and lift, relative to
        # `DEAREST_EFFORT` and `DEAREST_LIFT` times the weight on drag. The third measures how far the action limit is
        # lowered; at half of the limit it is 1.
        prices = torch.sqrt(w[[5, 2]] / (w[0] * self._tensor([DEAREST_EFFORT, DEAREST_LIFT])))
        share = limit / self._program.action_limit
        slower, faster = min(0.0, 2.5 * (speed - 1.0)), max(0.0, 2.5 * (speed - 1.0))
        parts = [1.0, slower, faster, *prices.clamp(max=1.0), min(1.0, 2.0 - 2.0 * share)]
        hidden = sum(part * self._tensor(each) for part, each in zip(parts, prior.first, strict=True))
        by_sums = nn.functional.linear((filters.T @ sums).flatten(), self._tensor(prior.sums).flatten(1))
        output = output * (1.0 + torch.tanh(self._tensor(prior.gate) @ self._tensor(parts) + by_sums))
        reach = max(0.5, share) * self._program.action_limit
        for action, is_free in zip(committed, chosen, strict=True):
            # The action of the present row is not known yet, so the past ends with the row before the present row.
            past = torch.cat([rows[: 1 if len(plan) == 0 else 0], rows[:-1]])[-memory:]
            units = torch.tanh(nn.functional.linear((filters.T @ past).flatten(), hidden.flatten(1)))
            plan.append((reach * torch.tanh(units @ output)).clamp(-limit, limit) if is_free else action)
            rows = torch.cat([past[-memory:], torch.cat([rows[-1, :-1], plan[-1][None]])[None]])
            following = nn.functional.linear(rows[-memory:].flatten(), predictor.flatten(1))
            rows = torch.cat([rows, torch.cat([following, following.new_zeros(1)])[None]])
        return torch.stack(plan)

    def terms(self, forces: Tensor, plan: Tensor, previous_action: Tensor, start: Tensor | None = None) -> Tensor:
        """Return the 8 cost terms without their weights, shape (8,). `start` is the initial plan; None means `plan`."""
        cd, cl = forces.unbind(dim=-1)
        return torch.stack(
            [
                cd.mean() - self._program.mpc.drag_reference,
                cd.max() - cd.min(),
                cl.abs().mean(),
                cl.mean().square(),
                plan.diff().square().mean(),
                plan.square().mean(),
                (plan[0] - previous_action).square(),
                (plan - (plan if start is None else start)).square().mean(),
            ]
        )

    def control_step(
        self,
        window: Array,
        plan: Array,
        free: Array,
        weights: Array | None = None,
        speed: float = 1.0,
        limit: float | None = None,
    ) -> tuple[Array, Array, Array, float]:
        """Return (new_plan, forces, terms, cost) as float64 arrays; arguments as in `contract.controller.interface`."""
        limit = min(self._program.action_limit, np.inf if limit is None else limit)
        w = self._tensor(self._program.mpc.weights.as_tuple() if weights is None else weights)
        previous_action = self._tensor(window[-1, -1])
        chosen = torch.tensor(free > 0.5)
        with torch.no_grad():
            z = self.encode(window)
        committed = torch.roll(self._tensor(plan), -1)
        committed[-1] = float(plan[-1])
        start = committed = self.start(window, committed, chosen, w, speed, limit)
        asked = w.clone()
        if self._program.prior is not None:
            asked[[0, 2, 5]] = 0.0  # drag, lift and effort: the prior was trained for these
        # Only the free actions are parameters, so the optimiser cannot change the committed actions.
        free_actions = committed[chosen].clone().requires_grad_(True)
        mpc = self._program.mpc
        optimiser = torch.optim.Adam([free_actions], lr=mpc.learning_rate, eps=mpc.epsilon)
        for _ in range(mpc.iterations if chosen.any() else 0):
            optimiser.zero_grad()
            whole = committed.masked_scatter(chosen, free_actions)
            cost = asked @ self.terms(self.predict(z, whole), whole, previous_action, start)
            torch.autograd.backward(cost)
            optimiser.step()
            with torch.no_grad():
                free_actions.clamp_(-limit, limit)
        with torch.no_grad():
            whole = committed.masked_scatter(chosen, free_actions)
            forces = self.predict(z, whole)
            terms = self.terms(forces, whole, previous_action, start)
        return _array(whole), _array(forces), _array(terms), float(w @ terms)

    def _tensor(self, values: object) -> Tensor:
        return torch.tensor(np.asarray(values), dtype=self._dtype)

    def _linear(self, layer: Linear) -> nn.Linear:
        outputs, inputs = layer.weight.shape
        module = nn.Linear(inputs, outputs, dtype=self._dtype)
        module.load_state_dict({"weight": self._tensor(layer.weight), "bias": self._tensor(layer.bias)})
        return module

    def _norm(self, norm: Norm) -> nn.LayerNorm:
        module = nn.LayerNorm(list(norm.weight.shape), dtype=self._dtype)
        module.load_state_dict({"weight": self._tensor(norm.weight), "bias": self._tensor(norm.bias)})
        return module


def _array(tensor: Tensor) -> Array:
    return tensor.detach().numpy().astype(np.float64)
