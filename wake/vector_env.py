"""The Gymnasium vector environment of `stillwake/TruckWake-v0`: several wakes in one process."""

import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import Any, TypeVar, cast

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.vector.utils import iterate

from contract.arrays import Array
from contract.errors import ConfigError
from contract.runtime.copies import CopiedWhole
from wake.env import TruckWakeEnv
from wake.plant.sample import Sample
from wake.truck.tape import Tape

T = TypeVar("T")
Actions = npt.NDArray[np.float32]


class TruckWakeVectorEnv(CopiedWhole, SyncVectorEnv):
    """A set of N independent `wake.env.TruckWakeEnv`. Their flows advance at the same time on the machine's cores.

    Each environment has bit for bit the observations, rewards, `info` and episodes of a single environment with equal
    seed and actions. `reset(seed=s)` gives the environments the seeds s, s + 1 and so on; `reset` also takes a list
    with a seed or None for each environment. The options of `TruckWakeEnv.reset` apply to all environments;
    `reset_mask`, a Boolean array, selects the environments to reset. A copy or a pickle, taken between two steps, is an
    independent environment that continues bit for bit. `wake.vector_env.BatchTape(env)` differentiates the batch.

    Args:
        num_envs: number of wakes.
        autoreset_mode: whether an environment whose episode has ended is reset by the next step (the default), by the
            step that ends the episode, or only by `reset`.
        threads: number of flows that advance at the same time; by default the number of processor cores that this
            process may use.
        settings: arguments of `TruckWakeEnv`, for all environments.

    Raises ConfigError if `num_envs` or `threads` is below 1, and the errors of `TruckWakeEnv`.
    """

    def __init__(
        self,
        num_envs: int = 1,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int | None = None,
        **settings: Any,
    ) -> None:
        if threads is None:  # macOS and Windows have no `sched_getaffinity`
            threads = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        for name, value in (("num_envs", num_envs), ("threads", threads)):
            if value < 1:
                raise ConfigError(f"{name} = {value}: must be at least 1")
        self._threads = threads
        super().__init__([partial(_one, settings)] * num_envs, autoreset_mode=autoreset_mode)
        first, *others = self.wakes
        for wake in others:
            wake.share_phases(first)

    @property
    def wakes(self) -> tuple[TruckWakeEnv, ...]:
        """The single environments; `wakes[i].plant` is the flow of environment i."""
        return tuple(cast(TruckWakeEnv, env.unwrapped) for env in self.envs)

    def step(self, actions: Actions) -> tuple[Any, ...]:
        """Ramp the jets of each wake to its action over one control period; `actions` has shape (N, 1). Raises the
        errors of `TruckWakeEnv.step`, but only after all flows have advanced."""
        waits = self._autoreset_envs if self.autoreset_mode == AutoresetMode.NEXT_STEP else np.zeros(self.num_envs)
        moving = [
            (env, action)
            for env, action, resets in zip(self.envs, iterate(self.action_space, actions), waits, strict=True)
            if not resets
        ]
        for (env, _), taken in zip(moving, self.at_once(lambda env, action: env.env.step(action), moving), strict=True):
            cast(_Ahead, env).taken = taken
        try:
            found: tuple[Any, ...] = super().step(actions)
        finally:  # An error can leave futures that were not read, and an environment with futures cannot be copied.
            for env in self.envs:
                cast(_Ahead, env).taken = None
        return found

    def at_once(self, work: Callable[..., T], arguments: Iterable[tuple[Any, ...]]) -> list[Future[T]]:
        """Call `work` with each tuple of arguments on this environment's threads. Return the calls' futures when all
        calls have ended, so that no error is raised while a flow runs."""
        with ThreadPoolExecutor(self._threads) as pool:
            return [pool.submit(work, *each) for each in arguments]


class _Ahead(gymnasium.Wrapper[Any, Any, Any, Any]):
    """An environment whose `step` returns the result of another thread for this step, if a thread has computed it."""

    def __init__(self, env: TruckWakeEnv) -> None:
        super().__init__(env)
        self.taken: Future[Any] | None = None

    def step(self, action: Any) -> Any:
        taken, self.taken = self.taken, None
        return self.env.step(action) if taken is None else taken.result()

    def reset(self, **given: Any) -> Any:
        self.taken = None
        observation, info = self.env.reset(**given)
        return observation, info | {"gradients": "wake.vector_env.BatchTape(env.unwrapped)"}


def _one(settings: dict[str, Any]) -> _Ahead:
    return _Ahead(TruckWakeEnv(**settings))


class BatchTape(CopiedWhole):
    """A set of tapes (`wake.truck.tape.Tape`), one for each wake of a vector environment. The tapes advance together,
    one control period at a time, on the environment's threads. They advance only the flows: the environment counts no
    steps and ends no episode. Every wake must be at the beginning of a control period, as after `reset`. `memory_mb` is
    the limit of the stored data of all tapes, in 10^6 bytes. A copy has its own environment."""

    def __init__(self, env: TruckWakeVectorEnv, memory_mb: float = 2000.0) -> None:
        self._env = env
        self.tapes = [Tape(wake.plant, memory_mb / env.num_envs) for wake in env.wakes]

    def advance(self, actions: Array) -> list[Sample]:
        """Advance each of the N flows by a control period, in which the jets ramp to the flow's action; `actions` has
        shape (N,). Raises PlantError as `Tape.advance` does."""
        ended = self._env.at_once(Tape.advance, zip(self.tapes, map(float, actions), strict=True))
        return [one.result() for one in ended]

    def back(self, weights: Sequence[Sample]) -> Array:
        """Go back by a control period on each tape; return the sensitivities to the N actions of this period, (N,).
        `weights` holds the weights of each wake's sample, as for `Tape.back`."""
        ended = self._env.at_once(Tape.back, zip(self.tapes, weights, strict=True))
        return np.array([one.result() for one in ended])

    def restart(self) -> None:
        """Empty all tapes, so that they begin at the present flows, and reuse their memory."""
        for tape in self.tapes:
            tape.restart()
