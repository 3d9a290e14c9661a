"""Whose the checkpoints in a folder are, known without torch; and threads that are given back."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from contract.config.tree import Config
from contract.errors import ConfigError, DatasetError
from train.fitting import unfinished
from train.fitting.fit import torch_threads
from train.fitting.progress import Phase
from train.fitting.unfinished import Identity, Reached

CONFIG = Config()
DATA = "0" * 64
REACHED = Reached(phase=Phase.FINISH, step=300, total=4000)


@pytest.fixture
def folder(tmp_path) -> Path:
    """Of a training that wrote a checkpoint."""
    folder = unfinished.folder_of(tmp_path / "model")
    unfinished.note(folder, identity(), REACHED)
    (folder / "fit.pt").write_bytes(b"")
    return folder


def identity(config: Config = CONFIG, data: str = DATA) -> Identity:
    return Identity.of(config, data, "cpu", None)


def test_the_same_training_goes_on_from_where_it_was(folder):
    assert unfinished.check(folder, identity()) == REACHED
    # What the training does not read does not bind it.
    assert unfinished.check(folder, identity(replace(CONFIG, mpc=replace(CONFIG.mpc, iterations=3)))) == REACHED
    # A damaged label is no reason to fail.
    for label in ("{", "{}", '{"reached": {"phase": "lunch", "step": 1, "total": 2}}'):
        (folder / "training.json").write_text(label)
        assert unfinished.reached(folder) is None, label


def test_another_training_is_refused_by_what_differs_and_with_both_ways(folder):
    other = replace(CONFIG, train=replace(CONFIG.train, seed=5))
    with pytest.raises(
        ConfigError, match=r"train\.seed = 0, not 5: finish it with its own settings, or start over with --restart"
    ):
        unfinished.check(folder, identity(other))
    # The plans from which slim networks learn are within the jets' limit.
    slim = replace(CONFIG, model=replace(CONFIG.model, slim_decoder_width=8))
    unfinished.note(folder, identity(slim), REACHED)
    with pytest.raises(ConfigError, match=r"action_limit = 0\.075, not 0\.1: finish it"):
        unfinished.check(folder, identity(replace(slim, flow=replace(slim.flow, action_limit=0.1))))
    unfinished.note(folder, identity(), REACHED)
    with pytest.raises(DatasetError, match="another recording"):
        unfinished.check(folder, identity(data="1" * 64))
    # A refinement of another model, or from another flow, is another one with equal settings.
    one, two = (Identity.of(CONFIG, DATA, "cpu", ("a", "b"), others={"model": word}) for word in "xy")
    unfinished.note(folder, one, REACHED)
    assert unfinished.check(folder, one) == REACHED
    with pytest.raises(ConfigError, match="an unfinished training with model = x, not y: finish it"):
        unfinished.check(folder, two)
    # A folder without a checkpoint binds no training.
    (folder / "fit.pt").unlink()
    assert unfinished.check(folder, identity(data="1" * 64)) is None


@pytest.mark.processes
def test_it_needs_no_torch():
    script = "import sys; import train.fitting.unfinished; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == 0


def test_no_threads_are_refused_and_a_stop_gives_them_back():
    before = torch.get_num_threads()
    with pytest.raises(ConfigError, match="threads = 0: must be at least 1"), torch_threads(0):
        raise AssertionError("computed")
    with pytest.raises(KeyboardInterrupt), torch_threads(before + 1):
        assert torch.get_num_threads() == before + 1
        raise KeyboardInterrupt
    assert torch.get_num_threads() == before
