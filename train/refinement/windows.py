"""The gradient of a stretch's mean cost with respect to the feedback's parameters, through feedback and flow. A stream
is a flow under the feedback; a stretch is an interval of a stream."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil, hypot
from typing import Final, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from contract.arrays import Array
from contract.controller.goal import OWN, Goal
from contract.controller.resampling import places
from contract.differentiable import DifferentiableFlow, FlowState, Seen
from train.refinement.feedback import Feedback

ROUNDED: Final = 0.05
"""Magnitude of Cl below which |Cl| is smoothed, because its gradient jumps at zero."""


@dataclass(frozen=True, kw_only=True)
class Price:
    """The weights of the cost of a period, `Cd + lift * |Cl| + motion * Uy^2 + effort * a^2`. |Cl| is smoothed within
    `ROUNDED`. Uy, the transverse velocity at the wake probe, indicates later drag. a is the action in force."""

    lift: float
    motion: float
    effort: float = 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class StretchReadings:
    """The errors of the values that the feedback receives in a stretch of n periods, with p pairs of sensors. `noise`
    (n, 2 p) is added to the sensors' Cp, pair by pair. `told` (n,) is the speed that the feedback receives, divided by
    the flow's speed. If a period's pressures are `lost` (n,), the last pressures replace them, and the command does not
    change."""

    noise: Array
    told: Array
    lost: NDArray[np.bool_]

    @classmethod
    def plain(cls, periods: int, pairs: int) -> Self:
        """Return readings without errors."""
        return cls(noise=np.zeros((periods, 2 * pairs)), told=np.ones(periods), lost=np.zeros(periods, dtype=bool))


@dataclass(kw_only=True, eq=False)
class Stream:
    """A flow that the feedback controls over several stretches (intervals). Speeds and `committed`, the action of the
    next period, are in units of the design speed.

    Attributes:
        rows: (n, 2 p + 1), oldest first. A row has p differences and p sums of the sensor pairs, and the action that
            started in the period. The last row is of the sample before the present sample. n is the feedback's memory
            M, or larger if the speed may be below the design speed, because rows are then resampled.
        speeds, speed: (n,) speeds that the feedback received with these rows; present speed of the flow.
        stretches: number of stretches that the stream has run.
    """

    state: FlowState
    rows: Array
    speeds: Array
    speed: float = 1.0
    committed: float = 0.0
    stretches: int = 0
    goal: Goal = OWN

    @classmethod
    def begun(cls, state: FlowState, feedback: Feedback, slowest: float = 1.0) -> Self:
        """Return a new stream without jets at the design speed; `slowest` is the lowest speed that will occur."""
        rows = ceil(feedback.memory / slowest) + (slowest < 1.0)
        row = np.concatenate([np.zeros(feedback.pairs), feedback.middles.numpy(), [0.0]])
        return cls(state=state, rows=np.tile(row, (rows, 1)), speeds=np.ones(rows))


@dataclass(frozen=True, kw_only=True, eq=False)
class Stretch:
    """The results of a stretch: the number of the stream, the stream after the stretch, the gradients of the mean cost
    in the order of the feedback's parameters, mean coefficients, and n resampled rows (n, p + 1). A row has the p
    differences without errors and the action, in units of the present speed. `off_design` is the largest distance of
    the speeds from the design speed, in units of the design speed."""

    number: int
    stream: Stream
    gradients: tuple[Tensor, ...]
    Cd: float
    abs_Cl: float
    rows: Array
    periods: int
    off_design: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Task:
    """A stretch of n periods to be run in the stream with this number. `speeds` (n + 1,) are the flow's speeds at the
    samples, in units of the design speed."""

    feedback: Feedback
    stream: Stream
    price: Price
    readings: StretchReadings
    speeds: Array
    number: int = 0


def differentiate(flow: DifferentiableFlow, task: Task) -> Stretch:
    """Run a stretch, and compute the gradients of the mean cost. The timing is as on the vehicle: the command computed
    from the sample of t_k is in force at the end of period k + 1. Raises PlantError if the flow diverged, or the
    stretch is too long for the tape's memory."""
    speeds, readings, stream = task.speeds, task.readings, replace(task.stream)
    task.feedback.zero_grad()
    run = closed_loop(flow, task.feedback, stream, readings, speeds)
    _go_back(flow, run, task.price, readings.told)
    past = speeds[:-1].tolist()
    count = len(places(past, len(past) * ceil(max(past))).newer)
    return Stretch(
        number=task.number,
        stream=stream,
        gradients=tuple(one.grad.clone() for one in task.feedback.parameters() if one.grad is not None),
        Cd=float(np.mean([one.Cd for one in run.seen[1:]])),
        abs_Cl=float(np.mean([abs(one.Cl) for one in run.seen[1:]])),
        rows=np.asarray(read(torch.from_numpy(run.true_rows), past, count)),
        periods=len(run.actions),
        off_design=float(np.abs(speeds - 1.0).max()),
    )


@dataclass(kw_only=True, eq=False)
class ClosedLoop:
    """The n + 1 samples, n actions and n commands of a stretch of n periods, on torch's graph for gradients. `leaves`
    are n rows (2 p + 1,) as the feedback received them. `true_rows` (n, p + 1) have differences without errors, and the
    action."""

    seen: list[Seen]
    actions: list[float]
    leaves: list[Tensor]
    commands: list[Tensor]
    true_rows: Array


def closed_loop(
    flow: DifferentiableFlow, feedback: Feedback, stream: Stream, readings: StretchReadings, speeds: Array
) -> ClosedLoop:
    """Run a stretch and advance the stream, without the backward pass. The jets have the limit of the stream's goal at
    every speed. Raises the errors of `differentiate`."""
    pairs, limit = feedback.pairs, stream.goal.share_of_limit() * feedback.limit
    rows, past = list(torch.from_numpy(stream.rows[1:])), stream.speeds[1:].tolist()
    leaves, commands, true_rows = list[Tensor](), list[Tensor](), list[list[float]]()
    seen, actions = [flow.begin(stream.state, speeds)], list[float]()
    kept = len(stream.rows)
    for k in range(len(readings.noise)):
        told = float(speeds[k] * readings.told[k])
        Cp = (seen[-1].Cp + readings.noise[k]) / readings.told[k] ** 2
        values = np.concatenate([Cp[::2] - Cp[1::2], Cp[::2] + Cp[1::2], [stream.committed]])
        leaves.append(torch.tensor(values, dtype=torch.float64, requires_grad=True))
        true_rows.append([*seen[-1].differences, stream.committed])
        before = leaves[-1][-1]
        rows.append(torch.cat([rows[-1][: 2 * pairs], before[None]]) if readings.lost[k] else leaves[-1])
        past.append(told)
        command = before
        if not readings.lost[k]:
            window = read(torch.stack(rows[-kept:]), past[-kept:], feedback.memory)
            action = feedback(window, told, stream.goal)
            command = before + min(1.0, told * told) * (action * told - before)
        commands.append(command.clamp(-limit, limit))
        seen.append(flow.advance(stream.committed))
        actions.append(stream.committed)
        stream.committed = float(commands[-1].detach())
    stream.speed = float(speeds[-1])
    stream.rows, stream.speeds = torch.stack(rows[-kept:]).detach().numpy(), np.array(past[-kept:])
    stream.state, stream.stretches = flow.state(), stream.stretches + 1
    return ClosedLoop(seen=seen, actions=actions, leaves=leaves, commands=commands, true_rows=np.array(true_rows))


def read(rows: Tensor, speeds: Sequence[float], memory: int) -> Tensor:
    """Resample a stream's rows, shape (n, c), to the M = `memory` rows that the feedback reads, shape (M, c), equally
    spaced in convective time as on the vehicle (`contract.controller.resampling`). For the interpolation, a row has the
    action that was in force at its sample, divided by the speed at that time. Then each row gets the action of the next
    row; the last row gets the action that starts now."""
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
    """Filter differences and sums as on the vehicle (`contract.controller.resampling.followed`)."""
    if min(speeds) >= 1.0:
        return rows
    weights = np.zeros((len(rows), len(rows)))
    weights[0, 0] = 1.0
    for k in range(1, len(rows)):
        share = min(1.0, speeds[k])
        weights[k, :k] = (1.0 - share) * weights[k - 1, :k]
        weights[k, k] = share
    return torch.cat([torch.from_numpy(weights) @ rows[:, :-1], rows[:, -1:]], dim=1)


def _go_back(flow: DifferentiableFlow, run: ClosedLoop, price: Price, told: Array) -> None:
    seen, leaves = run.seen, run.leaves
    periods, pairs = len(leaves), len(seen[0].Cp) // 2
    for k in reversed(range(periods)):
        after, to_Cp = seen[k + 1], np.zeros_like(seen[0].Cp)
        later = leaves[k + 1].grad if k + 1 < periods else None
        if later is not None:
            differences, sums = later.numpy()[:pairs], later.numpy()[pairs : 2 * pairs]
            to_Cp = np.column_stack([sums + differences, sums - differences]).ravel() / told[k + 1] ** 2
        to_command = flow.back(
            Seen(
                Cp=to_Cp,
                Cd=1.0 / periods,
                Cl=price.lift * after.Cl / hypot(after.Cl, ROUNDED) / periods,
                Uy=2.0 * price.motion * after.Uy / periods,
            )
        )
        if k > 0:
            total, own = to_command + 2.0 * price.effort * run.actions[k] / periods, leaves[k].grad
            total += 0.0 if own is None else float(own[-1])
            torch.autograd.backward(run.commands[k - 1], torch.tensor(total, dtype=torch.float64))
