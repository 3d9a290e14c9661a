"""A small policy trained through the flow: the flow's own gradient, with no model and no optimiser on the vehicle.

Two differences of mirrored sensors and the action over 64 periods, filtered to 17 numbers each, and an odd network
without biases: a mirrored wake gets the mirrored action, a symmetric one none. It begins at zero, which is no control,
and learns on the coarse mesh in truncated windows, one at a time from streams that go on under the policy and begin
again in the developed wake now and then. Each window's gradient is exact (`wake.truck.tape.Tape`), policy and plant
together. A stopped run goes on from its last windows.
"""

import time
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch

from benchmarks.common.command_line import progress as console
from benchmarks.common.parts import part
from benchmarks.roads.coarse import coarse, coarse_starts
from benchmarks.roads.cost import m7_ms, median_step_ms
from benchmarks.roads.loop import MIRROR_SENSORS, LawController, Setting, plant_outcome
from benchmarks.roads.mpc_90 import Windowed
from benchmarks.roads.row import Outcome, Row
from contract.arrays import Array, Index
from contract.atomic import replacing
from contract.config.body_sensors import layout_of
from contract.controller.interface import Sizes
from stillwake.console.terminal import progress_bar
from wake.plant.sample import Sample
from wake.truck.state import State
from wake.truck.tape import Tape, no_weights
from wake.truck.truck_wake import TruckWake

MEMORY: Final = 64
NEWEST: Final = 10
BUMPS: Final = 7
HIDDEN: Final = 24
SCALES: Final = (0.4, 0.15, 0.05)
"""Of the differences upper_39 - lower_39 and base_0 - base_9 in Cp, and of the action: roughly their deviations."""
UPDATES: Final = 300
SHORT: Final = 150
"""Updates with the shorter windows."""
WINDOWS: Final = (75, 125)
"""Periods of a window: the time of convection to the end of the bubble, and that at which drag has seen it."""
STREAMS: Final = 4
LIVES: Final = 10
"""Windows of a stream before it begins again."""
LIFT_PRICE: Final = 0.06
"""Of Cl squared."""
RATE: Final = 5e-3
HALVES_IN: Final = 120
"""Updates in which the rate halves."""
MEAN_OVER: Final = 30
"""Updates over which weights are averaged, and keep a share of 1 / e."""
KEEP_EVERY: Final = 4
SEED: Final = 0


def filters() -> torch.Tensor:
    """(64, 17): the newest ten rows each by itself, then means under overlapping bumps that widen with age."""
    age = np.arange(MEMORY)[::-1]
    knots = np.geomspace(NEWEST - 1, MEMORY, BUMPS + 2)
    bumps = [np.interp(age, knots[i : i + 3], (0.0, 1.0, 0.0)) for i in range(BUMPS)]
    columns = [(age == i).astype(float) for i in range(NEWEST)] + [bump / bump.sum() for bump in bumps]
    return torch.from_numpy(np.stack(columns, axis=1))


class Policy(torch.nn.Module):
    """History (64, 3) of both differences and the action, oldest row first -> the next action, U_inf W."""

    def __init__(self, limit: float) -> None:
        super().__init__()
        generator = torch.Generator().manual_seed(SEED)
        inputs = 3 * (NEWEST + BUMPS)
        first = torch.randn((inputs, HIDDEN), generator=generator, dtype=torch.float64) / inputs**0.5
        self.first = torch.nn.Parameter(first)
        self.second = torch.nn.Parameter(torch.zeros(HIDDEN, dtype=torch.float64))
        self._filters, self._limit = filters(), limit
        self._scales = torch.tensor(SCALES, dtype=torch.float64)

    def forward(self, history: torch.Tensor) -> torch.Tensor:
        inputs = (self._filters.T @ (history / self._scales)).flatten()
        result: torch.Tensor = self._limit * torch.tanh(torch.tanh(inputs @ self.first) @ self.second)
        return result

    def law(self, window: Array, committed: float) -> float:
        """As `benchmarks.roads.loop.Law`, with the mirror sensors in their order."""
        differences = window[:, [0, 2]] - window[:, [1, 3]]
        history = np.column_stack([differences, np.append(window[1:, -1], committed)])
        with torch.no_grad():
            return float(self(torch.from_numpy(history)))


@dataclass(kw_only=True, eq=False)
class Stream:
    """A flow under the policy: its state, its history (64, 3) whose last row is missing yet, and its windows so far."""

    state: State
    history: Array
    committed: float = 0.0
    windows: int = 0


class Windows:
    """The gradient of a window, policy and plant together.

    Args:
        columns: of the mirror sensors among the plant's.
    """

    def __init__(self, plant: TruckWake, policy: Policy, columns: Index, lift_price: float) -> None:
        self.plant, self.policy = plant, policy
        self._tape, self._columns, self._price = Tape(plant), columns.tolist(), lift_price

    def gradient(self, stream: Stream, periods: int) -> float:
        """Add the gradient of the window's mean cost to the policy's; the stream goes on. Returns the mean Cd."""
        self.plant.reset(stream.state)
        self._tape.restart()
        rows = list(torch.from_numpy(stream.history[1:]))
        leaves, commands, samples = list[torch.Tensor](), list[torch.Tensor](), [self.plant.sample()]
        for _ in range(periods):
            row = [*self._differences(samples[-1]), stream.committed]
            leaves.append(torch.tensor(row, dtype=torch.float64, requires_grad=True))
            rows.append(leaves[-1])
            commands.append(self.policy(torch.stack(rows[-MEMORY:])))
            samples.append(self._tape.advance(stream.committed))
            stream.committed = float(commands[-1].detach())
        stream.history = torch.stack(rows[-MEMORY:]).detach().numpy()
        stream.state, stream.windows = self.plant.state(), stream.windows + 1
        for k in reversed(range(periods)):
            seen = leaves[k + 1].grad if k + 1 < periods else None
            to_flow = self._tape.back(self._weights(samples[k + 1], seen, periods))
            to_policy = leaves[k].grad
            if k > 0:
                total = to_flow + (0.0 if to_policy is None else float(to_policy[2]))
                torch.autograd.backward(commands[k - 1], torch.tensor(total, dtype=torch.float64))
        return float(np.mean([sample.Cd for sample in samples[1:]]))

    def _differences(self, sample: Sample) -> tuple[float, float]:
        upper, lower, left, right = sample.Cp[self._columns]
        return float(upper - lower), float(left - right)

    def _weights(self, sample: Sample, seen: torch.Tensor | None, periods: int) -> Sample:
        zero = no_weights(len(self.plant.layout))
        if seen is not None:
            side, base = float(seen[0]), float(seen[1])
            zero.Cp[self._columns] = (side, -side, base, -base)
        return replace(zero, Cd=1.0 / periods, Cl=2.0 * self._price * sample.Cl / periods)


def learn(folder: Path, setting: Setting) -> dict[str, float]:
    """Train, or go on; the averaged policy is in the folder then. Returns interactions and minutes."""
    torch.set_num_threads(1)
    config = coarse(setting.config)
    plant = TruckWake(config.flow, body=config.body)
    starts = coarse_starts(setting.folder.parent, config, STREAMS)
    policy, mean = Policy(config.flow.action_limit), Policy(config.flow.action_limit)
    windows = Windows(plant, policy, plant.layout.indices(MIRROR_SENSORS), LIFT_PRICE)
    optimiser = torch.optim.Adam(policy.parameters(), lr=RATE)
    streams = [_begun(start) for start in starts]
    done, interactions, minutes = 0, 0, 0.0
    updates, kept = max(1, round(setting.budget * UPDATES)), folder / "training.pt"
    if kept.exists():
        tree = torch.load(kept, weights_only=False)
        policy.load_state_dict(tree["policy"])
        mean.load_state_dict(tree["mean"])
        optimiser.load_state_dict(tree["optimiser"])
        streams, done, interactions, minutes = (tree[name] for name in ("streams", "done", "interactions", "minutes"))
    began = time.process_time() - 60.0 * minutes
    with progress_bar("windows", estimate_over=3600.0, console=console) as bar:
        shown = bar.add_task("through the flow", total=updates, completed=done, note="")
        while done < updates:
            stream = streams[done % STREAMS]
            # Not all at once, so that the policy keeps seeing both the way down and where it leads.
            if stream.windows >= LIVES + done % STREAMS:
                stream = streams[done % STREAMS] = _begun(starts[done // STREAMS % STREAMS])
            periods = WINDOWS[0 if done < SHORT else 1]
            for group in optimiser.param_groups:
                group["lr"] = RATE * 0.5 ** (done / HALVES_IN)
            optimiser.zero_grad()
            drag = windows.gradient(stream, periods)
            torch.nn.utils.clip_grad_norm_(policy.parameters(), 0.5)
            optimiser.step()
            done, interactions = done + 1, interactions + periods
            _average(mean, policy, min(1.0 / done, 1.0 / MEAN_OVER) if done > MEAN_OVER else 1.0)
            minutes = (time.process_time() - began) / 60.0
            bar.update(shown, completed=done, note=f"window {stream.windows} of stream {done % STREAMS}: Cd {drag:.3f}")
            if done % KEEP_EVERY == 0 or done == updates:
                tree = {"policy": policy.state_dict(), "mean": mean.state_dict(), "optimiser": optimiser.state_dict()}
                facts = {"streams": streams, "done": done, "interactions": interactions, "minutes": minutes}
                with replacing(kept) as temporary:
                    torch.save({**tree, **facts}, temporary)
    return {"interactions": interactions, "minutes": minutes}


def measure(road: str, setting: Setting) -> Row:
    """Its row, straight on the plant: its memory is twice as long as that of the release's vehicle."""
    folder = setting.folder / f"{setting.budget:g}"
    folder.mkdir(exist_ok=True)
    learned: dict[str, Any] = part(folder / "learned.json", partial(learn, folder, setting))
    limit, horizon = setting.config.flow.action_limit, setting.config.mpc.horizon
    policy = Policy(limit)
    policy.load_state_dict(torch.load(folder / "training.pt", weights_only=False)["mean"])
    layout = layout_of(setting.config.body)
    read = [*layout.indices(MIRROR_SENSORS), len(layout)]

    def law(window: Array, committed: float) -> float:
        return policy.law(window[:, read], committed)

    def run(start: State) -> Outcome:
        return plant_outcome(setting.config, start, Windowed(law, length=MEMORY, sensors=len(layout)))

    sizes = Sizes(window=MEMORY, sensors=len(MIRROR_SENSORS), horizon=horizon)
    controller = LawController(policy.law, horizon=horizon, limit=limit, description="policy, PyTorch")
    inputs = NEWEST + BUMPS
    return Row(
        road=road,
        title="policy trained through the flow",
        kind="learned",
        outcomes=setting.outcomes(run, folder.name),
        sensors=sizes.sensors,
        loop="plant",
        mesh=setting.mesh,
        interactions=round(learned["interactions"]),
        training_minutes=learned["minutes"],
        step_ms=part(folder / "step_ms.json", lambda: median_step_ms(controller, sizes)),
        m7_ms=m7_ms(3 * MEMORY * inputs + 3 * inputs * HIDDEN + HIDDEN),
        seeds=(SEED,),
        note="learned on the coarse mesh by the flow's gradient, minutes with the plant's; float64, no model, no MPC",
    )


def _begun(start: State) -> Stream:
    return Stream(state=start, history=np.zeros((MEMORY, 3)))


def _average(mean: Policy, policy: Policy, share: float) -> None:
    with torch.no_grad():
        for kept, new in zip(mean.parameters(), policy.parameters(), strict=True):
            kept.lerp_(new, share)
