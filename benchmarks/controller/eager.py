"""The paper's control method in eager PyTorch: modules, autograd, torch.optim.Adam, clamp.

The networks are those of the training, so this implementation shares no formula with the project's reference
implementation. The parity tests compare the project's implementations with this one, and the benchmark gives all times
relative to this one.
"""

from collections.abc import Iterator
from typing import Any, Final

import numpy as np
import torch
from torch import Tensor, nn

from contract.arrays import Array
from contract.config.learning import ModelConfig
from contract.controller.goal import DEAREST_EFFORT, DEAREST_LIFT
from export.program.controller_program import ControllerProgram
from train.networks.model import WakeModel

_OF_LSTM: Final = {
    **{"weight_input": "weight_ih_l0", "weight_recurrent": "weight_hh_l0"},
    **{"bias_input": "bias_ih_l0", "bias_recurrent": "bias_hh_l0"},
}
"""PyTorch's names of an LSTM's tensors, by the names of their fields in `export.program.weights`."""


class EagerController:
    """The control step of `controller.onnx` in PyTorch, with derivatives by autograd, in a chosen precision."""

    def __init__(self, program: ControllerProgram, dtype: torch.dtype) -> None:
        self._program = program
        self._dtype = dtype
        encoder, dynamics, decoder = program.encoder, program.dynamics, program.decoder
        widths = {"lstm": encoder.lstm.width, "dynamics": len(dynamics.input.bias), "decoder": len(decoder.input.bias)}
        sizes = {f"{name}_width": width for name, width in widths.items()}
        config = ModelConfig(latent=program.latent, decoder_blocks=len(decoder.blocks), **sizes)
        networks = WakeModel(encoder.inputs - 1, config).to(dtype).eval().requires_grad_(False)
        for name in ("encoder", "dynamics", "decoder"):
            state = {key: self._tensor(values) for key, values in _tensors(getattr(program, name), "")}
            getattr(networks, name).load_state_dict(state)
        self._encoder, self._dynamics, self._decoder = networks.encoder, networks.dynamics, networks.decoder
        self._force_mean = self._tensor(program.scaling.force_mean)
        self._force_std = self._tensor(program.scaling.force_std)

    def encode(self, window: Array) -> Tensor:
        """Return the latent state, shape (n_z,). `window`, (L, S+1), has L rows with S sensors and the action."""
        scaling = self._program.scaling
        mean, std = self._tensor(scaling.window_mean), self._tensor(scaling.window_std)
        rows = self._tensor(window)[-self._program.encoder_rows :]
        _, (hidden, _) = self._encoder.lstm(((rows - mean) / std)[None])
        return self._encoder.read_out(hidden[-1, 0])

    def predict(self, z: Tensor, plan: Tensor) -> Tensor:
        """Return the forces over the horizon of H periods, shape (H, 2), under a plan, shape (H,)."""
        latents = self._dynamics.rollout(z, plan / self._program.scaling.action_std)
        forces: Tensor = self._decoder(latents) * self._force_std + self._force_mean
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


def _tensors(part: Any, prefix: str) -> Iterator[tuple[str, Array]]:
    """Yield the weights of a network by PyTorch's names."""
    for field, value in enumerate(part) if isinstance(part, tuple) else vars(part).items():
        name = f"{prefix}{_OF_LSTM.get(str(field), field)}"
        if isinstance(value, np.ndarray):
            yield name, value
        else:
            yield from _tensors(value, f"{name}.")


def _array(tensor: Tensor) -> Array:
    return tensor.detach().numpy().astype(np.float64)
