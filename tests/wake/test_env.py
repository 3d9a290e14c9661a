import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from contract.errors import ConfigError
from wake.env import TruckWakeEnv

LEDGER = {"t", "Cd", "Cl", "Cd_slot", "Cd_slot_pressure", "Cd_slot_viscous", "Cd_momentum", "jet_power", "Uy_probe"}


@pytest.fixture(scope="module")
def env() -> TruckWakeEnv:
    return TruckWakeEnv(("upper_39", "base_0"), episode_steps=3, max_lead_steps=2)


def test_gymnasiums_own_checker_is_content(env: TruckWakeEnv) -> None:
    check_env(env, skip_render_check=True)


def test_registered_under_the_documented_name() -> None:
    assert gymnasium.spec("stillwake/TruckWake-v0").entry_point == "wake.env:TruckWakeEnv"


def test_info_truncation_and_reward(env: TruckWakeEnv) -> None:
    observation, info = env.reset(seed=1)
    assert observation.shape == (2,) and observation.dtype == np.float32
    assert env.action_space.shape == (1,) and env.action_space.high[0] == np.float32(0.075)
    assert info.keys() >= LEDGER
    truncations = []
    for action in (0.0, 0.075, 0.2):
        observation, reward, terminated, truncated, info = env.step(np.array([action], dtype=np.float32))
        truncations.append(truncated)
        assert reward == -info["Cd"] and not terminated
    assert truncations == [False, False, True]
    assert info["clipped"] and info["action"] == 0.075


def test_the_bound_itself_is_not_clipped(env: TruckWakeEnv) -> None:
    env.reset(seed=1)
    assert not env.step(env.action_space.high)[4]["clipped"]


def test_seeds_choose_the_phase(env: TruckWakeEnv) -> None:
    first, again = env.reset(seed=3)[0], env.reset(seed=3)[0]
    assert np.array_equal(first, again)
    starts = {env.reset(seed=seed)[1]["t"] for seed in range(8)}
    assert len(starts) > 1


def test_unknown_sensor_is_refused() -> None:
    with pytest.raises(ConfigError, match="left_front"):
        TruckWakeEnv(("left_front",))
