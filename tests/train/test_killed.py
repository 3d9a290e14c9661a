"""A training that is killed outright goes on to the model of one that was left alone."""

import json
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from contract.config.loading import to_tree
from contract.config.tree import Config
from contract.recording import dataset
from contract.recording.dataset import Dataset
from train.pipeline import train_all

pytestmark = pytest.mark.processes

SCRIPT = """
import json, sys
from pathlib import Path
import torch
from contract.config.loading import from_tree
from train.pipeline import train_all
torch.set_num_threads(1)
recording, output, tree = sys.argv[1:]
train_all(Path(recording), from_tree(json.loads(tree)), Path(output))
"""


def test_sigkill_amid_the_fit_changes_nothing(small_recording: Dataset, small_config: Config, tmp_path: Path) -> None:
    recording = tmp_path / "recording.h5"
    dataset.write(recording, small_recording)
    config = replace(small_config, train=replace(small_config.train, epochs=50.0, stream_epochs=3.0))

    def start(name: str) -> subprocess.Popen[bytes]:
        arguments = [str(recording), str(tmp_path / name), json.dumps(to_tree(config))]
        return subprocess.Popen([sys.executable, "-c", SCRIPT, *arguments])

    train_all(recording, config, tmp_path / "whole")
    process = start("killed")
    checkpoint = tmp_path / "killed.checkpoints" / "fit.pt"
    while not checkpoint.exists():
        assert process.poll() is None, "ended before its first checkpoint"
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    assert not (tmp_path / "killed").exists()
    assert start("killed").wait() == 0
    whole, resumed = (tmp_path / name / "model.safetensors" for name in ("whole", "killed"))
    assert resumed.read_bytes() == whole.read_bytes()
