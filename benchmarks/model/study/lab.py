"""Data, settings and the folder of finished parts that every part of the study shares."""

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Final

import torch

from benchmarks.common.paper_data import of_the_paper, paper_file
from benchmarks.common.parts import part
from contract import sensors
from contract.config.loading import to_tree
from contract.config.tree import Config
from contract.recording import dataset
from contract.recording.dataset import Dataset, Episode
from contract.release.manifest import Scaling
from contract.shipped import RECORDING
from train.distillation.distil import distil
from train.distillation.evaluate import evaluate
from train.model_store import TrainedModel, load
from train.networks.model import Encoder, WakeModel
from train.samples.rows import Rows, prepare
from train.samples.scaling import fit_scaling

STREAM_EPOCHS: Final = 50.0
DISTIL_EPOCHS: Final = 1.0
"""A part of the release's, for students that are only compared with each other."""


@dataclass(frozen=True, kw_only=True)
class Lab:
    """What a worker needs to make a part; small, and sent to it.

    Attributes:
        config: the release's settings, but for how it chooses sensors.
        folder: of finished parts, of this configuration and this recording alone.
    """

    config: Config
    folder: Path

    def part(self, name: str, make: Callable[[], Any]) -> Any:
        """The finished part of that name, made now if it is not there: plain values for JSON."""
        return part(self.folder / f"{name}.json", make)

    def has(self, name: str) -> bool:
        return (self.folder / f"{name}.json").is_file()

    def seeded(self, seed: int) -> Config:
        return replace(self.config, train=replace(self.config.train, seed=seed))

    @property
    def recording(self) -> Path:
        """The paper's data set as a file."""
        return paper_file(self.folder.parent)

    def model_path(self, seed: int) -> Path:
        return self.folder / f"model_{seed}"

    def variant(self, name: str) -> Path:
        """Where a variant of the first seed's model is kept."""
        return self.folder / f"variant_{name}"

    def model(self, seed: int = 0) -> TrainedModel:
        return load(self.model_path(seed))


def open_lab(release: Config, parts: Path) -> Lab:
    """A lab whose folder is named after the configuration and the recording.

    Sensors are the paper's choice, nothing disturbs them, and the trained networks serve: what the release does
    otherwise is a part of its own.
    """
    config = replace(
        release,
        model=replace(release.model, slim_dynamics_width=None, slim_decoder_width=None),
        train=replace(release.train, selection="shap", sensor_noise=0.0),
    )
    tree = to_tree(config)
    text = json.dumps({name: tree[name] for name in ("model", "train", "mpc")}, sort_keys=True) + digest()
    folder = parts / hashlib.sha256(text.encode()).hexdigest()[:12]
    folder.mkdir(parents=True, exist_ok=True)
    return Lab(config=config, folder=folder)


@cache
def digest() -> str:
    return hashlib.sha256(RECORDING.read_bytes()).hexdigest()


@cache
def episodes(role: str) -> tuple[Episode, ...]:
    return _recording().with_role(role)  # type: ignore[arg-type]  # the roles are written in this package


@cache
def _recording() -> Dataset:
    return Dataset(episodes=tuple(filter(of_the_paper, dataset.read(RECORDING).episodes)))


@cache
def scaling() -> Scaling:
    return fit_scaling(episodes("train"))


@cache
def training_rows() -> Rows:
    return prepare(episodes("train"), scaling(), mirrored=True)


@cache
def test_rows(role: str = "test") -> Rows:
    return prepare(episodes(role), scaling(), mirrored=False)


def student(lab: Lab, teacher: WakeModel, names: tuple[str, ...], seed: int) -> tuple[Encoder, dict[str, Any]]:
    """A slim encoder on these sensors, and its figures on the chirp with the teacher's dynamics and decoder."""
    chosen = sensors.TRUCK.indices(names)
    config = lab.seeded(seed)
    shorter = replace(config.train, stream_epochs=STREAM_EPOCHS, distil_epochs=DISTIL_EPOCHS)
    slim = distil(teacher.encoder, training_rows(), chosen, replace(config, train=shorter))
    found = evaluate(slim, teacher, test_rows().with_sensors(chosen)).as_tree()
    return slim, {"sensors": list(names), "seed": seed, **found}


def quiet() -> None:
    """One thread a worker: parts run side by side."""
    torch.set_num_threads(1)
