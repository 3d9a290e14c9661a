"""Learning that is stopped and goes on, on a wake that costs nothing."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="the extra rl")

from benchmarks.roads import rl
from benchmarks.roads.loop import Setting
from contract.config.loading import load_config
from contract.release import bundle as bundles
from contract.shipped import BUNDLE
from wake.truck.state import State


class Still:
    """A wake that shows the same for ever."""

    def __init__(self, names, episode_steps, *rest: object, **options: object) -> None:
        self.names, self.left = names, episode_steps

    def reset(self, *, seed=None, options=None):
        return np.full(len(self.names), -0.4, dtype=np.float32), {}

    def step(self, action):
        ledger = {"Cd_net": 1.0, "jet_power": 0.0, "Cl": 0.0}
        return np.full(len(self.names), -0.4, dtype=np.float32), 0.0, False, False, ledger


@pytest.fixture
def setting(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Setting:
    monkeypatch.setattr(rl, "TruckWakeEnv", Still)
    monkeypatch.setattr(rl, "CHUNK", 25)
    state = State(flat=np.zeros(1), substep=0, action=0.0)
    monkeypatch.setattr(rl, "coarse_start", lambda folder, config: state)
    return Setting(folder=tmp_path, config=load_config(), phases=1)


@pytest.mark.slow  # the library is imported, and networks learn
@pytest.mark.filterwarnings("ignore:You have specified a mini-batch size")
@pytest.mark.parametrize("road", ["ppo", "sac"])
def test_a_stopped_learning_goes_on_and_its_policy_keeps_the_limit(road, setting, tmp_path):
    release = bundles.load(BUNDLE)
    first = rl.learn(road, 25, tmp_path, setting, release)
    algorithm, _ = rl._algorithm(road)
    assert algorithm.load(tmp_path / "policy.zip").num_timesteps == 25
    second = rl.learn(road, 50, tmp_path, setting, release)
    assert algorithm.load(tmp_path / "policy.zip").num_timesteps == 50
    assert 0.0 < first["minutes"] < second["minutes"]
    controller = rl._controller(road, tmp_path, release)
    horizon = release.manifest.mpc.horizon
    step = controller.control_step(np.full((32, 5), -0.4), np.full(horizon, 0.02), np.ones(horizon))
    assert step.plan[0] == 0.02 and np.abs(step.plan).max() <= release.manifest.action_limit
