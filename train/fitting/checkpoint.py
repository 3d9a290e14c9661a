"""Checkpoint files of a training. They are written completely or not at all; only a training with equal settings loads
them."""

import io
import os
import pickle
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import torch

from contract.atomic import replacing
from contract.errors import ConfigError, DatasetError, StillwakeError
from train.fitting.unfinished import Identity as Identity

_SCHEMA: Final = "stillwake-checkpoint/1"
_WAYS: Final = "delete it, or start over with --restart"


def save(path: Path, identity: Identity, state: Mapping[str, Any]) -> None:
    """Write `state` (tensors and plain values) atomically; raises StillwakeError if the file cannot be written."""
    body = {
        "schema": _SCHEMA,
        "settings": identity.settings,
        "dataset_sha256": identity.dataset_sha256,
        "state": dict(state),
    }
    # The file is built in memory first, because torch gives no clear error when a disk is full.
    image = io.BytesIO()
    torch.save(body, image)
    with replacing(path) as temporary, temporary.open("wb") as file:
        file.write(image.getbuffer())
        file.flush()
        os.fsync(file.fileno())


def load(path: Path, identity: Identity) -> dict[str, Any] | None:
    """Load the state saved at `path`, on the CPU; None if there is no file.

    Raises:
        StillwakeError: the file is damaged or of another schema.
        ConfigError: the file was written with other settings.
        DatasetError: the file was written for another recording.
    """
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
    if body["settings"] != identity.settings:
        raise ConfigError(f"checkpoint {path}: made with other settings; {_WAYS}")
    if body["dataset_sha256"] != identity.dataset_sha256:
        raise DatasetError(f"checkpoint {path}: made from another recording; {_WAYS}")
    return state
