"""The checkpoint files of a training. They are written completely or not at all, and loaded only with equal
settings."""

import io
import os
import pickle
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import torch

from contract.atomic import replacing
from contract.errors import ConfigError, DatasetError, StillwakeError
from train.fitting import unfinished
from train.fitting.unfinished import Identity, Phase, Reached

_SCHEMA: Final = "stillwake-checkpoint/1"
_WAYS: Final = "delete it, or start over with --restart"


@dataclass(frozen=True, kw_only=True)
class Checkpoints:
    """The folder in which the phases of a training store their state, one file per phase.

    Attributes:
        identity: settings and recording of the training.
        every: number of steps between two checkpoints.
    """

    folder: Path
    identity: Identity
    every: int = 100

    @classmethod
    def of(cls, output: Path, identity: Identity, resume: bool) -> "Checkpoints":
        """Return the checkpoints of the model `output`. With `resume`, the training continues from existing
        checkpoints; otherwise they are removed. Raises as `train.fitting.unfinished.check` does."""
        folder = unfinished.folder_of(output)
        if not resume:
            unfinished.clear(folder)
        unfinished.check(folder, identity)
        return cls(folder=folder, identity=identity)

    def path(self, phase: Phase) -> Path:
        return self.folder / f"{phase}.pt"

    def save(self, phase: Phase, state: Mapping[str, Any], reached: Reached | None = None) -> None:
        """Write a phase's state (tensors and plain values) atomically, and note the training's progress if it is given.
        Raises StillwakeError if a file cannot be written."""
        body = {
            "schema": _SCHEMA,
            "settings": self.identity.settings,
            "dataset_sha256": self.identity.dataset_sha256,
            "state": dict(state),
        }
        # The file is built in memory first, because torch gives no clear error when a disk is full.
        image = io.BytesIO()
        torch.save(body, image)
        with replacing(self.path(phase)) as temporary, temporary.open("wb") as file:
            file.write(image.getbuffer())
            file.flush()
            os.fsync(file.fileno())
        if reached is not None:
            unfinished.note(self.folder, self.identity, reached)

    def load(self, phase: Phase) -> dict[str, Any] | None:
        """Return a phase's state, on the CPU; None if no state is stored. Raises
        StillwakeError for a file that is damaged or of another schema, ConfigError for a file of other settings,
        DatasetError for a file of another recording."""
        path = self.path(phase)
        if not path.exists():
            return None
        try:
            # With weights_only, torch reads a checkpoint as data and runs no code from it.
            body = torch.load(path, map_location="cpu", weights_only=True)
            schema, state = body["schema"], dict(body["state"])
        except (OSError, RuntimeError, EOFError, KeyError, TypeError, ValueError, pickle.UnpicklingError) as error:
            raise StillwakeError(f"checkpoint {path}: damaged ({type(error).__name__}); {_WAYS}") from error
        if schema != _SCHEMA:
            raise StillwakeError(f"checkpoint {path}: schema {schema!r}, this version reads {_SCHEMA!r}; {_WAYS}")
        if body["settings"] != self.identity.settings:
            raise ConfigError(f"checkpoint {path}: made with other settings; {_WAYS}")
        if body["dataset_sha256"] != self.identity.dataset_sha256:
            raise DatasetError(f"checkpoint {path}: made from another recording; {_WAYS}")
        return state
