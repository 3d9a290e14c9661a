"""A small forced wake with the truck's symmetry: quick to make, and known exactly."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest
import torch

from contract import sensors
from contract.config.learning import ModelConfig, TrainConfig
from contract.config.tree import Config
from contract.recording.dataset import Dataset, Episode, Role
from train.networks.samples import Rows, fit_scaling, prepare

# Small networks gain nothing from more, and workers that run beside each other lose.
torch.set_num_threads(1)

PERIOD = 0.2
MakeEpisode = Callable[..., Episode]


def stuart_landau(action: npt.NDArray[np.float64], start: complex) -> npt.NDArray[np.complex128]:
    """Shedding at frequency 0.2 forced by the jets, sampled every control period; odd in (state, action)."""
    substeps, state = 20, start
    history = np.empty(len(action), dtype=np.complex128)
    step = PERIOD / substeps
    for k, a in enumerate(action):
        history[k] = state
        for _ in range(substeps):
            rate = (0.3 + 2j * np.pi * 0.2) * state - (0.3 + 0.1j) * abs(state) ** 2 * state + 8.0 * a
            state = state + step * rate
    return history


def observe(state: npt.NDArray[np.complex128], previous: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Cp (n, 90): waves that travel along the sides and across the base, odd ones and (at 2 f) even ones."""
    x, y = sensors.TRUCK.positions.T
    side = np.sign(y)
    reach = np.exp((x - x.max()) / 2.0)
    odd = np.real(state[:, None] * np.exp(-2j * x)) * side * np.abs(y) * reach
    even = np.real(state[:, None] ** 2 * np.exp(-4j * x)) * 0.3 * reach
    jet = previous[:, None] * side * np.exp((x - x.max()) * 8.0)
    return -0.4 - 0.05 * x + odd + even + jet


@pytest.fixture(scope="session")
def make_episode() -> MakeEpisode:
    """Build an episode: `make_episode(name, role, steps, seed)`; `forced=False` leaves the jets off."""

    def make(name: str, role: Role, steps: int, seed: int, *, forced: bool = True) -> Episode:
        generator = np.random.default_rng(seed)
        t = PERIOD * np.arange(steps, dtype=np.float64)
        phase = 2 * np.pi * np.cumsum(0.2 + 0.1 * np.sin(2 * np.pi * t / 37.0 + generator.uniform(0, 6))) * PERIOD
        action = 0.06 * np.sin(phase) * (1 + 0.25 * np.sin(t / 9.0)) if forced else np.zeros(steps)
        start = np.exp(1j * generator.uniform(0, 2 * np.pi))
        state = stuart_landau(action, start)
        previous = np.concatenate([[0.0], action[:-1]])
        Cp = observe(state, previous) + 1e-3 * generator.standard_normal((steps, sensors.COUNT))
        return Episode(
            name=name,
            role=role,
            series={
                "t": t,
                "action": action,
                "Cp": Cp,
                "Cd": 1.0 + 0.2 * np.abs(state) ** 2 + 0.05 * np.real(state**2),
                "Cl": np.real(state * np.exp(0.7j)),
            },
            initial_action=0.0,
            provenance={"seed": seed},
        )

    return make


@pytest.fixture(scope="session")
def small_config() -> Config:
    """Networks that train in seconds, and few draws of the ranking."""
    return Config(
        model=ModelConfig(window=12, lstm_width=32, dynamics_width=64, decoder_width=32, dropout=0.1),
        train=TrainConfig(
            segment=8, batch_size=256, schedule="one_cycle", learning_rate=5e-3, epochs=2.0, distil_epochs=2.0,
            shap_background=10, shap_explained=30, shap_repeats=2, shap_samples=4,
        ),
    )  # fmt: skip


@pytest.fixture(scope="session")
def small_recording(make_episode: MakeEpisode) -> Dataset:
    """Two training episodes and a test episode, a few hundred steps."""
    return Dataset(
        episodes=(
            make_episode("waveform", "train", 300, 1),
            make_episode("uncontrolled", "train", 80, 2, forced=False),
            make_episode("chirp", "test", 200, 3),
        )
    )


@pytest.fixture(scope="session")
def rows(small_recording: Dataset) -> Rows:
    """The training episodes and their mirror images, with all sensors."""
    episodes = small_recording.with_role("train")
    return prepare(episodes, fit_scaling(episodes), mirrored=True)
