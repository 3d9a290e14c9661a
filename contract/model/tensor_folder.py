"""What the model folders share: tensors in `model.safetensors`, and a JSON description that holds their hash.

Nothing here knows what the tensors mean. safetensors is imported when it is needed: a vehicle imports this package and
has none.
"""

import hashlib
import json
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from contract.atomic import replacing
from contract.errors import ModelError

WEIGHTS: Final = "model.safetensors"
_HASH: Final = "weights_sha256"

Tensors = dict[str, npt.NDArray[Any]]


def write_folder(path: Path, name: str, body: Mapping[str, Any], tensors: Mapping[str, npt.NDArray[Any]]) -> None:
    """Write both files, the description under this name and with the tensors' hash, whole or not at all."""
    import safetensors.numpy

    weights = safetensors.numpy.save({key: np.ascontiguousarray(value) for key, value in tensors.items()})
    described = {**body, _HASH: hashlib.sha256(weights).hexdigest()}
    with replacing(path) as temporary:
        temporary.mkdir()
        (temporary / WEIGHTS).write_bytes(weights)
        (temporary / name).write_text(json.dumps(described, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def read_body(path: Path, name: str, schemas: Collection[str]) -> dict[str, Any]:
    """The description of one of these schemas, the newest of which stands first; else raises ModelError."""
    try:
        body = json.loads(_read_bytes(path, name))
    except ValueError as error:
        raise ModelError(f"model {path}: {name}: not JSON ({error})") from error
    schema = body.get("schema") if isinstance(body, dict) else None
    if not isinstance(body, dict) or schema not in schemas:
        raise ModelError(f"model {path}: {name}: schema {schema!r}, this version reads {next(iter(schemas))!r}")
    return body


def check_entries(path: Path, name: str, body: Mapping[str, Any], entries: Collection[str]) -> None:
    """Raise ModelError if the description lacks one of these, or the hash."""
    for entry in (*entries, _HASH):
        if entry not in body:
            raise ModelError(f"model {path}: {name} lacks {entry!r}")


def read_tensors(path: Path, name: str, body: Mapping[str, Any]) -> Tensors:
    """The tensors that the description is of; raises ModelError if they were altered or are damaged."""
    import safetensors
    import safetensors.numpy

    raw = _read_bytes(path, WEIGHTS)
    if hashlib.sha256(raw).hexdigest() != body[_HASH]:
        raise ModelError(f"model {path}: {WEIGHTS} was altered (SHA-256 does not match {name})")
    try:
        tensors: Tensors = safetensors.numpy.load(raw)
    except (safetensors.SafetensorError, ValueError) as error:
        raise ModelError(f"model {path}: {WEIGHTS}: not a safetensors file ({error})") from error
    return tensors


def _read_bytes(path: Path, name: str) -> bytes:
    try:
        return (path / name).read_bytes()
    except OSError as error:
        raise ModelError(f"model {path}: {name} cannot be read ({error.strerror or error})") from error
