"""The checkpoints of an unfinished training. A file in their folder states the training's identity and progress. This
file is read without torch, which takes seconds to load, so another training's checkpoints are refused without delay.
All files are written completely or not at all."""

import io
import json
import os
import pickle
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from contract.atomic import replacing
from contract.config.tree import Config
from contract.errors import ConfigError, DatasetError, StillwakeError
from contract.typed import differences
from train.fitting.progress import Phase

_LABEL: Final = "training.json"
_WAYS: Final = "finish it with its own settings, or start over with --restart"


@dataclass(frozen=True, kw_only=True)
class Identity:
    """The identity of a checkpoint's training: the recording, and the canonical text of the settings that determine the
    result. With another number of torch's threads the training can continue, but sums are added in another order."""

    settings: str
    dataset_sha256: str
    threads: int = 1

    @classmethod
    def of(
        cls,
        config: Config,
        dataset_sha256: str,
        device: str,
        chosen: Sequence[str] | None,
        threads: int = 1,
        others: Mapping[str, Any] | None = None,
    ) -> "Identity":
        """Return the identity of a training on the device "cpu" or "cuda". The caller may have `chosen` sensors.
        `others` are further settings by name: those of a refinement, and the hashes of its first files."""
        of_lessons = {"weights": asdict(config.mpc.weights), "action_limit": config.flow.action_limit}
        settings = {
            "model": asdict(config.model),
            "train": asdict(config.train),
            "horizon": config.mpc.horizon,
            **(of_lessons if config.model.is_slimmed else {}),
            "device": device,
            "chosen": None if chosen is None else list(chosen),
            **(others or {}),
        }
        return cls(settings=json.dumps(settings, sort_keys=True), dataset_sha256=dataset_sha256, threads=threads)


@dataclass(frozen=True, kw_only=True)
class Reached:
    """The last checkpoint of a training: `step` of `total` iterations of a phase."""

    phase: Phase
    step: int
    total: int

    def __str__(self) -> str:
        return f"{self.phase.label}, iteration {self.step} of {self.total}"


def folder_of(output: Path) -> Path:
    """Return the checkpoint folder of the model `output`."""
    return output.with_name(f"{output.name}.checkpoints")


def check(folder: Path, identity: Identity) -> Reached | None:
    """Return the progress of the training in this folder; None if the folder has no checkpoints. Raises ConfigError,
    which names the first difference, if the settings differ; DatasetError if the recording is another."""
    if not any(folder.glob("*.pt")):
        return None
    label = _label(folder)
    # If the folder states no settings, each checkpoint is checked when it is loaded (`Checkpoints.load`).
    if label is not None and "settings" in label:
        settings = json.loads(identity.settings)
        for name, there, here in differences(label.get("settings"), settings):
            raise ConfigError(f"{folder} holds an unfinished training with {name} = {there}, not {here}: {_WAYS}")
        if label.get("dataset_sha256") != identity.dataset_sha256:
            raise DatasetError(f"{folder} holds an unfinished training on another recording: {_WAYS}")
    return reached(folder)


def note(folder: Path, identity: Identity, reached: Reached) -> None:
    """Store a training's identity and progress after a checkpoint. Raises StillwakeError if writing fails."""
    label = {
        "settings": json.loads(identity.settings),
        "dataset_sha256": identity.dataset_sha256,
        "reached": asdict(reached),
        "threads": sorted({*threads(folder), identity.threads}),
    }
    with replacing(folder / _LABEL) as temporary:
        temporary.write_text(json.dumps(label, sort_keys=True), encoding="utf-8")


def reached(folder: Path) -> Reached | None:
    """Return the progress that was stored last; None if no progress was stored."""
    noted = (_label(folder) or {}).get("reached", {})
    try:
        phase = {str(phase): phase for phase in Phase}[noted["phase"]]
        return Reached(phase=phase, step=int(noted["step"]), total=int(noted["total"]))
    except (TypeError, ValueError, KeyError):
        return None


def threads(folder: Path) -> tuple[int, ...]:
    """Return all numbers of torch's threads that this training used; empty if no number is stored."""
    noted = (_label(folder) or {}).get("threads")
    return tuple(noted) if isinstance(noted, list) and all(isinstance(item, int) for item in noted) else ()


def _label(folder: Path) -> dict[str, Any] | None:
    try:
        label = json.loads((folder / _LABEL).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return label if isinstance(label, dict) else None


_SCHEMA: Final = "stillwake-checkpoint/1"
_MEND: Final = "delete it, or start over with --restart"


@dataclass(frozen=True, kw_only=True)
class Checkpoints:
    """The folder in which the phases of a training store their state, one file per phase, every `every` steps."""

    folder: Path
    identity: Identity
    every: int = 100

    @classmethod
    def of(cls, output: Path, identity: Identity, resume: bool) -> "Checkpoints":
        """Return the checkpoints of the model `output`. With `resume`, the training continues from existing
        checkpoints; otherwise they are removed. Raises the errors of `check`."""
        folder = folder_of(output)
        if not resume:
            shutil.rmtree(folder, ignore_errors=True)
        check(folder, identity)
        return cls(folder=folder, identity=identity)

    def path(self, phase: Phase) -> Path:
        return self.folder / f"{phase}.pt"

    def save(self, phase: Phase, state: Mapping[str, Any], reached: Reached | None = None) -> None:
        """Write a phase's state (tensors and plain values) atomically, and store the training's progress if it is
        given. Raises StillwakeError if a file cannot be written."""
        import torch

        own = self.identity
        body = {"schema": _SCHEMA, "settings": own.settings, "dataset_sha256": own.dataset_sha256, "state": dict(state)}
        # The file is built in memory first, because torch gives no clear error when a disk is full.
        image = io.BytesIO()
        torch.save(body, image)
        with replacing(self.path(phase)) as temporary, temporary.open("wb") as file:
            file.write(image.getbuffer())
            file.flush()
            os.fsync(file.fileno())
        if reached is not None:
            note(self.folder, self.identity, reached)

    def load(self, phase: Phase) -> dict[str, Any] | None:
        """Return a phase's state, on the CPU; None if no state is stored. Raises StillwakeError if the file is damaged
        or has another schema, ConfigError if it has other settings, DatasetError if it has another recording."""
        import torch

        path = self.path(phase)
        if not path.exists():
            return None
        try:
            # With weights_only, torch reads a checkpoint as data and runs no code from it.
            body = torch.load(path, map_location="cpu", weights_only=True)
            schema, state = body["schema"], dict(body["state"])
        except (OSError, RuntimeError, EOFError, KeyError, TypeError, ValueError, pickle.UnpicklingError) as error:
            raise StillwakeError(f"checkpoint {path} is damaged ({type(error).__name__}); {_MEND}") from error
        if schema != _SCHEMA:
            raise StillwakeError(f"checkpoint {path} has schema {schema!r}, not {_SCHEMA!r}; {_MEND}")
        if body["settings"] != self.identity.settings:
            raise ConfigError(f"checkpoint {path} was made with other settings; {_MEND}")
        if body["dataset_sha256"] != self.identity.dataset_sha256:
            raise DatasetError(f"checkpoint {path} was made from another recording; {_MEND}")
        return state
