"""One episode of a recording: what a process needs to know to record it, block by block."""

import hashlib
import platform
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from contract.config import Config
from contract.dataset import UNITS, Episode
from contract.errors import StillwakeError
from contract.results import versions
from wake.blocks import EpisodeBlocks, Series
from wake.episode_plan import EpisodePlan
from wake.forcing import SIGNALS
from wake.grid import truck_grid
from wake.truck_wake import Sample, TruckWake, developed_state

Array = npt.NDArray[np.float64]
Progress = Callable[[str, int, int], None]
"""Called with (episode, steps done, steps in all)."""


@dataclass(frozen=True, kw_only=True)
class EpisodeJob:
    """What it takes to record one episode, in this process or in another that sees the same folder.

    Attributes:
        parts: folder of the recording's unfinished work.
        owner: of the call of `record` that this belongs to; work stops when another one has taken the folder over.
        setting: what every sample depends on; see `setting_of`.
    """

    parts: Path
    owner: str
    plan: EpisodePlan
    config: Config
    block_steps: int
    setting: Mapping[str, Any]

    @property
    def blocks(self) -> EpisodeBlocks:
        return EpisodeBlocks(folder=self.parts / self.plan.name, steps=self.plan.steps, block_steps=self.block_steps)

    def run(self, wake: TruckWake | None = None, progress: Progress = lambda name, done, total: None) -> None:
        """Record what is missing; `wake` is built if not given.

        Raises:
            StillwakeError: if the folder is not to be seen from here, a block cannot be written, this process has
                other versions or another start than the one that began the recording, or another call took over.
            PlantError: if the flow diverges.
        """
        if not self._is_owner():
            raise StillwakeError(
                f"{self.parts} is not to be seen from {platform.node()}: it must lie on a shared folder"
            )
        mine = setting_of(self.config)
        if mine != self.setting:
            raise StillwakeError(f"{platform.node()} would record with other {differing(mine, self.setting)}")
        plan, blocks = self.plan, self.blocks
        if blocks.finished == plan.steps:
            return
        wake = TruckWake(self.config.flow) if wake is None else wake
        actions = SIGNALS[plan.forcing](
            plan.steps, self.config.forcing, self.config.flow, np.random.default_rng(plan.seed)
        )
        first = blocks.finished
        if first:
            sample = wake.reset(blocks.end())
        else:
            sample = wake.reset(developed_state())
            for _ in range(plan.lead):
                sample = wake.advance(0.0)
        while first < plan.steps:
            if not self._is_owner():
                raise StillwakeError(f"{self.parts}: stopped, or taken over by another call")
            block = actions[first : first + self.block_steps]
            series, sample = _advance(wake, sample, block)
            blocks.add(series, wake.state())
            first += len(block)
            progress(plan.name, first, plan.steps)

    def episode(self) -> Episode:
        """The finished episode."""
        return Episode(
            name=self.plan.name,
            role=self.plan.role,
            series=self.blocks.series(),
            initial_action=0.0 if self.plan.lead else developed_state().action,
            provenance={
                **self.setting,
                "forcing_signal": self.plan.forcing,
                "seed": self.plan.seed,
                "lead_steps": self.plan.lead,
            },
        )

    def _is_owner(self) -> bool:
        try:
            return owner_file(self.parts).read_text() == self.owner
        except OSError:
            return False


def setting_of(config: Config) -> dict[str, Any]:
    """Everything but the plan that decides the samples, as plain JSON."""
    start = files("wake").joinpath("data/developed.npz").read_bytes()
    return {
        "flow": asdict(config.flow),
        "forcing": asdict(config.forcing),
        "grid": list(truck_grid().shape),
        "start": "wake/data/developed.npz",
        "start_sha256": hashlib.sha256(start).hexdigest(),
        "versions": {"python": platform.python_version(), **versions("stillwake", "numpy", "numba", "scipy")},
    }


def differing(a: Mapping[str, Any], b: Mapping[str, Any]) -> str:
    return ", ".join(sorted(key for key in a.keys() | b.keys() if a.get(key) != b.get(key)))


def owner_file(parts: Path) -> Path:
    return parts / "owner"


def _advance(wake: TruckWake, sample: Sample, actions: Array) -> tuple[Series, Sample]:
    """Samples of a block that begins with `sample`, and the one after it."""
    rows: list[Sample] = []
    for action in actions:
        rows.append(sample)
        sample = wake.advance(float(action))
    series = {name: np.array([getattr(row, name) for row in rows]) for name in UNITS}
    # A sample knows the action in force when it was taken; a recording holds the one commanded then.
    return series | {"action": actions}, sample
