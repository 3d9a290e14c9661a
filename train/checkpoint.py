"""Training state on disk: written whole or not at all, and read back only into the run it came from."""

import pickle
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import torch

from contract.atomic import replacing
from contract.errors import ConfigError, DatasetError, StillwakeError

SCHEMA: Final = "stillwake-checkpoint/1"


@dataclass(frozen=True, kw_only=True)
class Identity:
    """What a checkpoint belongs to.

    Attributes:
        settings: canonical text of the configuration that decides the result.
        dataset_sha256: of the recording.
    """

    settings: str
    dataset_sha256: str


def save(path: Path, identity: Identity, state: Mapping[str, Any]) -> None:
    """Write `state` (tensors and plain values) atomically; raises StillwakeError if the place cannot be written."""
    body = {
        "schema": SCHEMA,
        "settings": identity.settings,
        "dataset_sha256": identity.dataset_sha256,
        "state": dict(state),
    }
    with replacing(path) as temporary:
        torch.save(body, temporary)


def load(path: Path, identity: Identity) -> dict[str, Any] | None:
    """The state saved at `path`, on the CPU; None if there is no file.

    Raises:
        StillwakeError: if the file is damaged or of another schema.
        ConfigError: if it was written under other settings.
        DatasetError: if it was written for another recording.
    """
    if not path.exists():
        return None
    try:
        # weights_only: a checkpoint is data, it must not be able to run code.
        body = torch.load(path, map_location="cpu", weights_only=True)
        schema, state = body["schema"], dict(body["state"])
    except (OSError, RuntimeError, EOFError, KeyError, TypeError, ValueError, pickle.UnpicklingError) as error:
        raise StillwakeError(f"checkpoint {path}: damaged ({type(error).__name__}); delete it to start over") from error
    if schema != SCHEMA:
        raise StillwakeError(f"checkpoint {path}: schema {schema!r}, this version reads {SCHEMA!r}")
    if body["settings"] != identity.settings:
        raise ConfigError(f"checkpoint {path}: made with other settings; delete it to start over")
    if body["dataset_sha256"] != identity.dataset_sha256:
        raise DatasetError(f"checkpoint {path}: made from another recording; delete it to start over")
    return state
