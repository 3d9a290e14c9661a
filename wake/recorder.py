"""Recording episodes of the forced wake: blocks on disk that survive a kill, then one HDF5 data set.

An episode advances block by block. Each finished block is one file holding its samples and the plant's state at its
end, written whole or not at all, so a recording that was stopped at any instant continues from the last finished
block and gives the same samples as one that was not.
"""

import json
import platform
import shutil
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final
from zipfile import BadZipFile

import numpy as np
import numpy.typing as npt

from contract.atomic import replacing
from contract.config import Config
from contract.dataset import UNITS, Dataset, Episode, Role, write
from contract.errors import StillwakeError
from wake.forcing import SIGNALS, ForcingName
from wake.truck_wake import Sample, State, TruckWake, developed_state

Array = npt.NDArray[np.float64]

BLOCK_STEPS: Final = 100


@dataclass(frozen=True, kw_only=True)
class EpisodePlan:
    """One episode to record: a forcing signal of so many control steps, and what it is for."""

    forcing: ForcingName
    steps: int
    seed: int

    @property
    def role(self) -> Role:
        """The paper tests on the chirp and trains on the rest."""
        return "test" if self.forcing == "chirp" else "train"

    @property
    def name(self) -> str:
        return f"{self.forcing}_{self.seed}"


def record(
    output: Path,
    plans: Iterable[EpisodePlan],
    config: Config,
    progress: Callable[[str, int, int], None] = lambda name, done, total: None,
) -> None:
    """Record every plan from the developed start and write the data set.

    Unfinished work is kept in `<output>.parts` and continued by the next call with the same plans and settings.

    Args:
        output: the HDF5 file.
        plans: episodes, in the order they will have in the file.
        config: flow and forcing settings.
        progress: called with (episode, steps done, steps in all) after every block.

    Raises:
        StillwakeError: if the output cannot be written, or the parts there belong to other plans or settings.
    """
    plans = list(plans)
    parts = output.with_name(output.name + ".parts")
    _claim(parts, plans, config)
    wake = TruckWake(config.flow)
    episodes = [_record_episode(parts, plan, config, wake, progress) for plan in plans]
    write(output, Dataset(episodes=tuple(episodes)))
    shutil.rmtree(parts)


def _claim(parts: Path, plans: list[EpisodePlan], config: Config) -> None:
    """Make the folder of parts ours, or make sure it already is."""
    task = json.dumps({"plans": [asdict(plan) for plan in plans], **_settings(config)}, sort_keys=True)
    label = parts / "task.json"
    if label.is_file() and label.read_text() != task:
        raise StillwakeError(f"{parts} holds an unfinished recording with other settings: finish or delete it first")
    with replacing(label) as temporary:
        temporary.write_text(task)


def _settings(config: Config) -> dict[str, Any]:
    return {"flow": asdict(config.flow), "forcing": asdict(config.forcing)}


def _record_episode(
    parts: Path, plan: EpisodePlan, config: Config, wake: TruckWake, progress: Callable[[str, int, int], None]
) -> Episode:
    actions = SIGNALS[plan.forcing](plan.steps, config.forcing, config.flow, np.random.default_rng(plan.seed))
    state = developed_state()
    initial_action = state.action
    blocks: list[dict[str, Array]] = []
    for first in range(0, plan.steps, BLOCK_STEPS):
        path = parts / f"{plan.name}_{first:06d}.npz"
        block = actions[first : first + BLOCK_STEPS]
        if not path.is_file():
            _record_block(path, block, wake, state)
        series, state = _read_block(path)
        blocks.append(series)
        progress(plan.name, first + len(block), plan.steps)
    return Episode(
        name=plan.name,
        role=plan.role,
        series={name: np.concatenate([block[name] for block in blocks]) for name in UNITS},
        initial_action=initial_action,
        provenance={
            **_settings(config),
            "forcing_signal": plan.forcing,
            "seed": plan.seed,
            "grid": list(wake.grid.shape),
            "start": "wake/data/developed.npz",
            "versions": {
                "python": platform.python_version(),
                **{package: version(package) for package in ("stillwake", "numpy", "numba", "scipy")},
            },
        },
    )


def _record_block(path: Path, actions: Array, wake: TruckWake, state: State) -> None:
    sample = wake.reset(state)
    rows: list[Sample] = []
    for action in actions:
        rows.append(sample)
        sample = wake.advance(float(action))
    end = wake.state()
    arrays: dict[str, Any] = {name: [getattr(row, name) for row in rows] for name in UNITS}
    # A sample knows the action in force when it was taken; a recording holds the one commanded then.
    arrays |= {"action": actions, "end": end.flat, "end_substep": end.substep, "end_action": end.action}
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez(file, **arrays)


def _read_block(path: Path) -> tuple[dict[str, Array], State]:
    try:
        with np.load(path) as data:
            state = State(flat=data["end"], substep=int(data["end_substep"]), action=float(data["end_action"]))
            return {name: data[name] for name in UNITS}, state
    except (OSError, KeyError, ValueError, EOFError, BadZipFile) as error:
        raise StillwakeError(f"{path}: damaged block ({error}); delete it to record it again") from error
