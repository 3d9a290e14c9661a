"""Rows of reinforcement learning: PPO and SAC of Stable-Baselines3 on the release's sensors and window.

With as many control periods as the shipped recording has, times the budget, on the coarse mesh; the row is of the
deterministic policy through bus and ECU. A stopped run goes on from its last thousand periods, with an episode of its
own, so that its policy differs from one that was not stopped.
"""

import time
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.common.command_line import progress as console
from benchmarks.common.parts import part
from benchmarks.roads.coarse import coarse, coarse_start
from benchmarks.roads.cost import m7_ms, median_step_ms
from benchmarks.roads.loop import LawController, Setting, through_can
from benchmarks.roads.release import recorded_periods
from benchmarks.roads.rl_env import LIFT_PRICE, RemembersWake, observed
from benchmarks.roads.row import Outcome, Row
from contract.arrays import Array
from contract.errors import StillwakeError, install
from contract.release import bundle as bundles
from contract.release.checks import Bundle
from contract.shipped import BUNDLE
from stillwake.console.terminal import progress_bar
from wake.env import TruckWakeEnv
from wake.truck.state import State

EPISODE: Final = 250
"""Control periods: ten shedding cycles."""
CHUNK: Final = 1000
WIDTHS: Final = (64, 64)
DISCOUNT: Final = 0.98
"""A reward counts half after 34 periods."""
SEED: Final = 0


def measure(road: str, setting: Setting) -> Row:
    """PPO's or SAC's."""
    release = bundles.load(BUNDLE)
    interactions = max(CHUNK, round(setting.budget * recorded_periods() / CHUNK) * CHUNK)
    folder = setting.folder / f"{interactions}"
    folder.mkdir(exist_ok=True)
    learned = part(folder / "learned.json", partial(learn, road, interactions, folder, setting, release))

    def run(start: State) -> Outcome:
        return through_can(release, setting.config, start, _controller(road, folder, release))

    sizes = release.manifest.sizes
    inputs = sizes.window * (sizes.sensors + 1) + 1
    products = sum(a * b for a, b in zip((inputs, *WIDTHS), (*WIDTHS, 1), strict=True))
    return Row(
        road=road,
        title=f"{road.upper()} on the release's sensors and window",
        kind="learned",
        outcomes=setting.outcomes(run, f"{interactions}"),
        sensors=sizes.sensors,
        loop="CAN",
        mesh=setting.mesh,
        interactions=interactions,
        training_minutes=learned["minutes"],
        step_ms=part(folder / "step_ms.json", lambda: median_step_ms(_controller(road, folder, release), sizes)),
        m7_ms=m7_ms(products),
        seeds=(SEED,),
        note=f"learned on the coarse mesh; reward: less Cd_net + jet power + {LIFT_PRICE:g} of abs Cl",
    )


def learn(road: str, interactions: int, folder: Path, setting: Setting, release: Bundle) -> dict[str, float]:
    """Learn so many periods, or go on; the policy is in the folder then."""
    algorithm, options = _algorithm(road)
    config = coarse(setting.config)
    start = coarse_start(setting.folder.parent, config)
    wake = TruckWakeEnv(release.manifest.sensors, EPISODE, config.flow, start=start, body=config.body)
    task = RemembersWake(wake, release.manifest)
    kept, spent = folder / "policy.zip", folder / "spent.npy"
    if kept.exists():
        model = algorithm.load(kept, env=task)
        before = float(np.load(spent))
        if hasattr(model, "replay_buffer"):
            model.load_replay_buffer(folder / "replay.pkl")
    else:
        model = algorithm("MlpPolicy", task, seed=SEED, gamma=DISCOUNT, device="cpu", **options)
        before = 0.0
    began = time.process_time()

    def minutes() -> float:
        return before + (time.process_time() - began - task.plant_seconds) / 60.0

    with progress_bar("periods", estimate_over=3600.0, console=console) as bar:
        shown = bar.add_task(road, total=interactions, note="")
        while model.num_timesteps < interactions:
            model.learn(CHUNK, reset_num_timesteps=False)
            model.save(kept)
            if hasattr(model, "replay_buffer"):
                model.save_replay_buffer(folder / "replay.pkl")
            np.save(spent, minutes())
            bar.update(shown, completed=model.num_timesteps, note=_reward(model))
    return {"minutes": minutes()}


def _reward(model: Any) -> str:
    episodes = [episode["r"] for episode in model.ep_info_buffer or ()]
    return f"reward {np.mean(episodes) / EPISODE:+.3f} a period" if episodes else ""


def _controller(road: str, folder: Path, release: Bundle) -> LawController:
    algorithm, _ = _algorithm(road)
    policy = algorithm.load(folder / "policy.zip", device="cpu").policy
    manifest = release.manifest

    def law(window: Array, committed: float) -> float:
        action, _ = policy.predict(observed(manifest, window, committed), deterministic=True)
        return float(action[0]) * manifest.action_limit

    return LawController(
        law, horizon=manifest.mpc.horizon, limit=manifest.action_limit, description=f"{road.upper()}, PyTorch"
    )


def _algorithm(road: str) -> tuple[Any, dict[str, Any]]:
    """The class and what is set; everything else is the library's default."""
    try:
        import stable_baselines3
        import torch
    except ImportError as error:
        raise StillwakeError(f"{road} needs stable-baselines3: {install('rl')} ({error})") from error
    torch.set_num_threads(1)
    widths = {"policy_kwargs": {"net_arch": list(WIDTHS)}}
    if road == "ppo":
        return stable_baselines3.PPO, {**widths, "n_steps": CHUNK, "batch_size": 125, "n_epochs": 10}
    return stable_baselines3.SAC, {**widths, "learning_starts": 500, "learning_rate": 1e-3, "buffer_size": 200_000}
