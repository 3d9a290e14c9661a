"""A trained model on disk: a directory with `model.safetensors` and `model.json`, written completely or not at all.

`model.safetensors` has the weights. The prefix `encoder.` marks the trained encoder of all sensors (the teacher), and
`slim.` marks the encoder of few sensors. Further prefixes are `dynamics.`, `decoder.` and, with narrower networks,
`slim_dynamics.` and `slim_decoder.`. `model.json` has the schema, the SHA-256 of the weights, and a `Description`.

This module returns tensors as arrays, from which `train` builds networks and `export` builds a controller program.
safetensors is imported only when needed, because a vehicle uses this package but does not install safetensors.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from contract.atomic import write_files
from contract.config.loading import from_tree, to_tree
from contract.config.tree import Config
from contract.errors import ConfigError, ModelError, StillwakeError
from contract.release.manifest import RestingWake, Scaling
from contract.sensor_layout import SensorLayout
from contract.sensors import TRUCK
from contract.typed import typed

MODEL_SCHEMA: Final = "stillwake-model/2"
MODEL_SCHEMA_1: Final = "stillwake-model/1"
"""First schema, which this version can still read. It states no layout; the sensors are the truck's 90 sensors."""
DESCRIPTION: Final = "model.json"
MODEL_WEIGHTS: Final = "model.safetensors"
SLIM: Final = "slim"
PRIOR: Final = "prior"
"""Prefix of the tensors of the prior, which computes the initial plan of the MPC (`train.refinement`)."""
RESTING: Final = "resting"
"""Name of a tensor that accompanies the prior's tensors: K rows of speed, base pressure and swing of the wake without
jets (`contract.release.manifest.RestingWake`), (K, 3)."""
AIR_SPEED: Final = "air_speed"
"""Name of a tensor that accompanies the prior's tensors: the weights of `contract.controller.air_speed`."""
PREDICTOR: Final = ("dynamics", "decoder")
"""Networks that a model may have in a second, narrower form. The names of narrower networks begin with `SLIM`."""
_NETWORKS: Final = ("encoder", SLIM, PRIOR, *PREDICTOR, *(f"{SLIM}_{name}" for name in PREDICTOR))
_HASH: Final = "weights_sha256"
_ENTRIES: Final = ("config", "dataset_sha256", "metrics", "ranking", "scaling", "sensors", "versions", _HASH)
Tensors = Mapping[str, npt.NDArray[Any]]
"""Arrays by name."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Description:
    """The assumptions and the origin of a model's weights.

    Attributes:
        layout, scaling: layout and scaling of all sensors, in the same order.
        sensors: names of the sensors that the slim encoder reads, in the order of its inputs.
        dataset_sha256: SHA-256 of the recording to which the model was fitted.
        metrics: errors by name. "teacher", "slim" and, with narrower networks, "deployed" are each a
            `train.distillation.evaluate.EncoderMetrics`. "slim_latent" is the mean absolute error of the slim encoder's
            latents against the teacher's, divided by their standard deviation.
        ranking: method and order of the sensors; for SHAP also the scores and the stability of the best sets.
        versions: versions of the software; "torch_threads" is the number of threads during training.
    """

    config: Config
    scaling: Scaling
    sensors: tuple[str, ...]
    dataset_sha256: str
    metrics: Mapping[str, Any]
    ranking: Mapping[str, Any]
    versions: Mapping[str, str]
    layout: SensorLayout = TRUCK

    def __post_init__(self) -> None:
        self.layout.indices(self.sensors)
        for wrong, found, count in self.scaling.misfits(len(self.layout)):
            raise ModelError(f"scaling.{wrong} has {found} values, must have {count}")


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelFolder:
    """A verified model directory. `config_tree` has the settings as stored, without the defaults of later versions."""

    description: Description
    tensors: Tensors
    weights_sha256: str
    config_tree: Mapping[str, Any]

    def network(self, name: str) -> dict[str, npt.NDArray[Any]]:
        """Return one network's tensors by the names of its state dict; empty if the model lacks this network."""
        return {key.partition(".")[2]: value for key, value in self.tensors.items() if key.split(".")[0] == name}

    def deployed(self, name: str) -> dict[str, npt.NDArray[Any]]:
        """Return the tensors of the deployed `dynamics` or `decoder`: of the narrower network if the model has one."""
        return self.network(f"{SLIM}_{name}") or self.network(name)

    @property
    def prior(self) -> dict[str, npt.NDArray[Any]]:
        """The tensors of the prior; empty if the model has no prior."""
        return {name: value for name, value in self.network(PRIOR).items() if name not in (RESTING, AIR_SPEED)}

    @property
    def resting(self) -> RestingWake | None:
        """The wake without jets at each speed; None if the model has one speed. Raises ModelError for a wrong shape."""
        table = self.tensors.get(f"{PRIOR}.{RESTING}")
        if table is None:
            return None
        if table.ndim != 2 or table.shape[1] != 3:
            raise ModelError(f"{PRIOR}.{RESTING} has shape {table.shape}: must have shape (speeds, 3)")
        speeds, base, swing = map(tuple, table.T.astype(np.float64).tolist())
        return RestingWake(speeds=speeds, base=base, swing=swing)

    @property
    def air_speed(self) -> tuple[float, ...] | None:
        """The weights with which the air speed is estimated; None if the model has no such weights."""
        weights = self.tensors.get(f"{PRIOR}.{AIR_SPEED}")
        return None if weights is None else tuple(weights.astype(np.float64).ravel().tolist())


def check_free(path: Path) -> None:
    """Raise StillwakeError if `path` exists and is neither a model directory nor an empty directory."""
    if path.exists() and not (path.is_dir() and ((path / DESCRIPTION).is_file() or not any(path.iterdir()))):
        raise StillwakeError(f"{path}: exists and is not a model directory; name another directory")


def write(path: Path, description: Description, tensors: Tensors) -> None:
    """Write or replace a model directory. Raises StillwakeError as `check_free` does, or if writing fails."""
    import safetensors.numpy

    check_free(path)
    layout = description.layout
    weights = safetensors.numpy.save({key: np.ascontiguousarray(value) for key, value in tensors.items()})
    body = {
        "schema": MODEL_SCHEMA,
        **vars(description),
        "config": to_tree(description.config),
        "scaling": asdict(description.scaling),
        "layout": {
            "names": layout.names,
            "positions": layout.positions.tolist(),
            "base": layout.base.tolist(),
            "mirror": None if layout.mirror is None else layout.mirror.tolist(),
        },
        _HASH: hashlib.sha256(weights).hexdigest(),
    }
    text = json.dumps(body, indent=2, allow_nan=False) + "\n"
    write_files(path, {MODEL_WEIGHTS: weights, DESCRIPTION: text.encode()})


def read_description(path: Path) -> dict[str, Any]:
    """Read a model's description. Raises ModelError if the description is incomplete or has an unsupported schema."""
    try:
        body = json.loads(_read_bytes(path, DESCRIPTION))
    except ValueError as error:
        raise ModelError(f"model {path}: {DESCRIPTION} is not JSON ({error})") from error
    schema = body.get("schema") if isinstance(body, dict) else None
    if not isinstance(body, dict) or schema not in (MODEL_SCHEMA, MODEL_SCHEMA_1):
        raise ModelError(f"model {path}: {DESCRIPTION} has schema {schema!r}; this version reads {MODEL_SCHEMA!r}")
    for entry in _ENTRIES if schema == MODEL_SCHEMA_1 else (*_ENTRIES, "layout"):
        if entry not in body:
            raise ModelError(f"model {path}: {DESCRIPTION} lacks {entry!r}")
    return body


def read(path: Path) -> ModelFolder:
    """Read and verify a model directory. Raises ModelError if a file is missing, damaged, altered or of another schema,
    or if parts of the description contradict each other; the message states the file and the entry."""
    import safetensors
    import safetensors.numpy

    body, raw = read_description(path), _read_bytes(path, MODEL_WEIGHTS)
    if hashlib.sha256(raw).hexdigest() != body[_HASH]:
        raise ModelError(f"model {path}: {MODEL_WEIGHTS} was altered (SHA-256 does not match {DESCRIPTION})")
    try:
        tensors = safetensors.numpy.load(raw)
    except (safetensors.SafetensorError, ValueError) as error:
        raise ModelError(f"model {path}: {MODEL_WEIGHTS} is not a safetensors file ({error})") from error
    description = _describe(path, body)
    for key in sorted(tensors):
        if key.split(".")[0] not in _NETWORKS:
            raise ModelError(f"model {path}: {MODEL_WEIGHTS} has the unknown tensor {key}")
    return ModelFolder(description=description, tensors=tensors, weights_sha256=body[_HASH], config_tree=body["config"])


def _read_bytes(path: Path, name: str) -> bytes:
    try:
        return (path / name).read_bytes()
    except OSError as error:
        raise ModelError(f"model {path}: {name} cannot be read ({error.strerror or error})") from error


def _describe(path: Path, body: Mapping[str, Any]) -> Description:
    try:
        layout = TRUCK
        if "layout" in body:
            tree = body["layout"]
            layout = SensorLayout(
                names=tuple(tree["names"]),
                positions=np.array(tree["positions"], dtype=np.float64),
                base=np.array(tree["base"], dtype=np.intp),
                mirror=None if tree["mirror"] is None else np.array(tree["mirror"], dtype=np.intp),
            )
        return Description(
            config=from_tree(body["config"]),
            scaling=typed(body["scaling"], Scaling),
            sensors=tuple(body["sensors"]),
            layout=layout,
            **{name: body[name] for name in ("dataset_sha256", "metrics", "ranking", "versions")},
        )
    except (ConfigError, ModelError, KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise ModelError(f"model {path}: {DESCRIPTION}: {error}") from error
