"""What the kinds of model folder share: `model.safetensors`, and a description in JSON that holds its hash.

Nothing here knows what the tensors mean. safetensors is imported when it is needed: a vehicle imports this package and
has none.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from contract.atomic import replacing
from contract.errors import ModelError, StillwakeError

WEIGHTS: Final = "model.safetensors"
_HASH: Final = "weights_sha256"

Tensors = Mapping[str, npt.NDArray[Any]]
"""Arrays by name."""


@dataclass(frozen=True, kw_only=True)
class FolderKind:
    """A kind of model folder.

    Attributes:
        schemas: that are read, the one that is written first.
        entries: of every description, with the schema and the tensors' hash.
    """

    noun: str
    description: str
    schemas: tuple[str, ...]
    entries: tuple[str, ...]

    def is_at(self, path: Path) -> bool:
        """Whether a directory claims to be of this kind."""
        return (path / self.description).is_file()

    def check_free(self, path: Path) -> None:
        """Raise StillwakeError if writing to `path` would replace anything but a folder of this kind."""
        if path.exists() and not (path.is_dir() and (self.is_at(path) or not any(path.iterdir()))):
            raise StillwakeError(f"{path}: exists and is not {self.noun}; choose another place")

    def write(self, path: Path, entries: Mapping[str, Any], tensors: Tensors) -> None:
        """Write both files, whole or not at all, in place of a folder of this kind. Raises StillwakeError if the place
        cannot be written or holds something else."""
        import safetensors.numpy

        self.check_free(path)
        weights = safetensors.numpy.save({key: np.ascontiguousarray(value) for key, value in tensors.items()})
        body = {"schema": self.schemas[0], **entries, _HASH: hashlib.sha256(weights).hexdigest()}
        with replacing(path) as temporary:
            temporary.mkdir()
            (temporary / WEIGHTS).write_bytes(weights)
            text = json.dumps(body, indent=2, allow_nan=False) + "\n"
            (temporary / self.description).write_text(text, encoding="utf-8")

    def read_description(self, path: Path) -> dict[str, Any]:
        """The description, complete and of a schema that is read; raises ModelError if it is not."""
        try:
            body = json.loads(_read_bytes(path, self.description))
        except ValueError as error:
            raise ModelError(f"model {path}: {self.description}: not JSON ({error})") from error
        schema = body.get("schema") if isinstance(body, dict) else None
        if not isinstance(body, dict) or schema not in self.schemas:
            known = repr(self.schemas[0])
            raise ModelError(f"model {path}: {self.description}: schema {schema!r}, this version reads {known}")
        for entry in (*self.entries, _HASH):
            if entry not in body:
                raise ModelError(f"model {path}: {self.description} lacks {entry!r}")
        return body

    def read(self, path: Path) -> tuple[dict[str, Any], dict[str, npt.NDArray[Any]]]:
        """Description and tensors; raises ModelError if one is missing, damaged, altered or of another schema."""
        import safetensors
        import safetensors.numpy

        body, raw = self.read_description(path), _read_bytes(path, WEIGHTS)
        if hashlib.sha256(raw).hexdigest() != body[_HASH]:
            raise ModelError(f"model {path}: {WEIGHTS} was altered (SHA-256 does not match {self.description})")
        try:
            return body, safetensors.numpy.load(raw)
        except (safetensors.SafetensorError, ValueError) as error:
            raise ModelError(f"model {path}: {WEIGHTS}: not a safetensors file ({error})") from error


def _read_bytes(path: Path, name: str) -> bytes:
    try:
        return (path / name).read_bytes()
    except OSError as error:
        raise ModelError(f"model {path}: {name} cannot be read ({error.strerror or error})") from error
