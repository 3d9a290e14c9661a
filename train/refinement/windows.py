"""The gradient of a stretch of closed loop, feedback and flow together, and the streams that stretches are cut from."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, inf
from typing import Self

import numpy as np
import torch
from torch import Tensor

from contract.arrays import Array
from contract.controller.resampling import places
from train.refinement.feedback import Feedback
from train.refinement.flow import DifferentiableFlow, FlowState, Iterating, Iterations, Seen


@dataclass(frozen=True, kw_only=True)
class Price:
    """What a period costs: Cd + lift Cl^2 + motion Uy^2 + effort a^2.

    Attributes:
        lift: of the squared lift coefficient.
        motion: of the squared transverse velocity at the wake probe, which foretells drag that lies beyond the stretch.
        effort: of the squared action in force.
    """

    lift: float
    motion: float
    effort: float = 0.0


@dataclass(kw_only=True, eq=False)
class Recalled:
    """What the controller's iterations are given again in the next period.

    Attributes:
        window: (L, 2 p + 1), rows (Cp, action in force), oldest first; its first row is repeated before there is one.
        plan: (H,), the last one.
        in_force: the action in force at the next sample.
    """

    window: Array
    plan: Array
    in_force: float = 0.0

    @classmethod
    def begun(cls, sizes: Iterating, cp: Array) -> Self:
        """Before the first period, at a wake without jets."""
        return cls(window=np.tile(np.append(cp, 0.0), (sizes.window, 1)), plan=np.zeros(sizes.horizon))

    def change(self, iterations: Iterations, cp: Array, committed: float, command: float) -> float:
        """What the iterations add to the prior's command for the next period, with one action under way."""
        self.window = np.vstack([self.window[1:], np.append(cp, self.in_force)])
        last, free = self.plan.copy(), np.ones(len(self.plan))
        # The control step shifts the plan by a step.
        last[1], free[0] = committed, 0.0
        self.plan, self.in_force = iterations.plan(self.window, last, free), committed
        return float(self.plan[1]) - command


@dataclass(kw_only=True, eq=False)
class Stream:
    """A flow under the feedback, from stretch to stretch.

    Attributes:
        state: where it stands.
        rows: (n, p + 1) of differences and of the action that each period began, oldest first; the present row is still
            to come. n is the feedback's memory M at the design speed and above, more for slower ones.
        speeds: (n,) of these rows, in design speeds.
        speed: at which it stands.
        committed: the action of the period that begins, in units of the design speed.
        stretches: that it has run.
        recalled: of the controller's iterations; None before the first period, and without them.
    """

    state: FlowState
    rows: Array
    speeds: Array
    speed: float = 1.0
    committed: float = 0.0
    stretches: int = 0
    recalled: Recalled | None = None

    @classmethod
    def begun(cls, state: FlowState, memory: int, columns: int, slowest: float = 1.0) -> "Stream":
        """From a flow without jets at the design speed; `slowest` is the least speed to come."""
        rows = ceil(memory / slowest) + (slowest < 1.0)
        return cls(state=state, rows=np.zeros((rows, columns)), speeds=np.ones(rows))


@dataclass(frozen=True, kw_only=True, eq=False)
class Stretch:
    """What a stretch was: mean coefficients, and its rows (n, p + 1) of true differences and actions as they are read.

    Coefficients and rows are of the present speed. `off_design` is the largest distance of the speeds from the design
    speed, in design speeds.
    """

    Cd: float
    abs_Cl: float
    rows: Array
    periods: int
    off_design: float = 0.0


def differentiate(
    flow: DifferentiableFlow,
    feedback: Feedback,
    stream: Stream,
    price: Price,
    noise: Array,
    iterating: Iterating | None = None,
    *,
    speeds: Array | None = None,
    action_limit: float = inf,
) -> Stretch:
    """Add the gradient of the stretch's mean cost to that of the feedback's parameters; the stream goes on.

    The timing is the vehicle's: the command made from the sample of t_k is in force at the end of period k + 1.

    Args:
        noise: (n, p), what is added to the differences that the feedback reads, one row a period.
        iterating: the controller's iterations, which change each command; that change is a number on the way back, as
            if it did not depend on the weights. At the design speed alone.
        speeds: (n + 1,) at the samples, in design speeds; the design speed without.
        action_limit: of the jets, whatever the speed is, in units of the design speed.

    Raises:
        PlantError: the flow diverged, or the stretch is too long for the tape's memory.
    """
    periods = len(noise)
    speeds = np.ones(periods + 1) if speeds is None else speeds
    rows: list[Tensor] = list(torch.from_numpy(stream.rows[1:]))
    past = [*stream.speeds[1:].tolist()]
    leaves, commands, true_rows = list[Tensor](), list[Tensor](), list[list[float]]()
    seen, actions = [flow.begin(stream.state, speeds)], list[float]()
    iterations = None
    if iterating is not None:
        iterations = iterating.of(feedback.as_prior())
        stream.recalled = stream.recalled or Recalled.begun(iterating, seen[0].Cp)
    kept = len(stream.rows)
    for k in range(periods):
        speed = float(speeds[k])
        noted = noise[k] / speed**2
        leaves.append(
            torch.tensor([*(seen[-1].differences + noted), stream.committed], dtype=torch.float64, requires_grad=True)
        )
        true_rows.append([*seen[-1].differences, stream.committed])
        rows.append(leaves[-1])
        past.append(speed)
        before = leaves[-1][-1]
        command = feedback(read(torch.stack(rows[-kept:]), past[-kept:], feedback.memory), speed) * speed
        command = before + min(1.0, speed * speed) * (command - before)
        if iterations is not None and stream.recalled is not None:
            cp = seen[-1].Cp + np.column_stack([0.5 * noted, -0.5 * noted]).ravel()
            command = command + stream.recalled.change(iterations, cp, stream.committed, float(command.detach()))
        commands.append(command.clamp(-action_limit, action_limit))
        seen.append(flow.advance(stream.committed))
        actions.append(stream.committed)
        stream.committed = float(commands[-1].detach())
    stream.speed = float(speeds[-1])
    stream.rows, stream.speeds = torch.stack(rows[-kept:]).detach().numpy(), np.array(past[-kept:])
    stream.state, stream.stretches = flow.state(), stream.stretches + 1
    _go_back(flow, seen, actions, leaves, commands, price)
    return Stretch(
        Cd=float(np.mean([one.Cd for one in seen[1:]])),
        abs_Cl=float(np.mean([abs(one.Cl) for one in seen[1:]])),
        rows=_stretch_read(np.array(true_rows), speeds[:-1]),
        periods=periods,
        off_design=float(np.abs(speeds - 1.0).max()),
    )


def read(rows: Tensor, speeds: Sequence[float], memory: int) -> Tensor:
    """(M, p + 1) as the feedback reads them, from rows (n, p + 1) of a stream: at the present speed, as on the vehicle.

    There a row has the action in force at its sample, in units of the speed at that time; the row of the present sample
    has the one that begins.
    """
    rows = _followed(rows, speeds)
    where = places(speeds, memory)
    if len(where.newer) < memory:
        raise ValueError(f"{len(rows)} rows do not reach back over {memory} steps at these speeds")
    began = rows[:, -1]
    in_force = torch.cat([began[:1], began[:-1]]) / torch.tensor(speeds, dtype=torch.float64)
    newer, share = torch.from_numpy(where.newer), torch.from_numpy(where.share)
    older = (newer - (share > 0.0).long()).clamp(min=0)
    window = torch.cat([rows[:, :-1], in_force[:, None]], dim=1)
    window = window[newer] + share[:, None] * (window[older] - window[newer])
    actions = torch.cat([window[1:, -1], began[-1:] / speeds[-1]])
    return torch.cat([window[:, :-1], actions[:, None]], dim=1)


def _followed(rows: Tensor, speeds: Sequence[float]) -> Tensor:
    """Rows whose differences are as the vehicle keeps them (`contract.controller.resampling.followed`)."""
    if min(speeds) >= 1.0:
        return rows
    weights = np.zeros((len(rows), len(rows)))
    weights[0, 0] = 1.0
    for k in range(1, len(rows)):
        share = min(1.0, speeds[k])
        weights[k, :k] = (1.0 - share) * weights[k - 1, :k]
        weights[k, k] = share
    return torch.cat([torch.from_numpy(weights) @ rows[:, :-1], rows[:, -1:]], dim=1)


def _stretch_read(rows: Array, speeds: Array) -> Array:
    """All rows of a stretch, as far as they go at their speeds."""
    steps = int(speeds[1:].sum()) + 1
    return np.asarray(read(torch.from_numpy(rows), speeds.tolist(), steps))


def _go_back(
    flow: DifferentiableFlow,
    seen: list[Seen],
    actions: list[float],
    leaves: list[Tensor],
    commands: list[Tensor],
    price: Price,
) -> None:
    periods = len(leaves)
    for k in reversed(range(periods)):
        after, later = seen[k + 1], leaves[k + 1].grad if k + 1 < periods else None
        to_read = np.zeros_like(after.differences) if later is None else later[:-1].numpy()
        to_command = flow.back(
            Seen(
                Cp=np.column_stack([to_read, -to_read]).ravel(),
                Cd=1.0 / periods,
                Cl=2.0 * price.lift * after.Cl / periods,
                Uy=2.0 * price.motion * after.Uy / periods,
            )
        )
        if k > 0:
            own = leaves[k].grad
            total = to_command + 2.0 * price.effort * actions[k] / periods + (0.0 if own is None else float(own[-1]))
            torch.autograd.backward(commands[k - 1], torch.tensor(total, dtype=torch.float64))
