"""Read a trained model directory (`model.safetensors`, `model.json`) as arrays, without PyTorch.

The 4-sensor encoder (`slim.`) becomes the program's encoder; the 90-sensor teacher (`encoder.`) stays behind. So do
the wide dynamics and decoder where the model holds slim ones (`slim_dynamics.`, `slim_decoder.`).
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import dacite
import numpy as np
import numpy.typing as npt
import safetensors
import safetensors.numpy

from contract import sensors as sensor_facts
from contract.config.loading import from_tree
from contract.config.tree import Config, MpcConfig
from contract.errors import ConfigError, ExportError
from contract.release.bundle import Scaling
from export.program.controller_program import ControllerProgram
from export.program.weights import State

SCHEMA: Final = "stillwake-model/1"
DESCRIPTION: Final = "model.json"
WEIGHTS: Final = "model.safetensors"
NETWORKS: Final = ("slim", "dynamics", "decoder")
_TEACHER: Final = "encoder"
_SLIMMED: Final = ("dynamics", "decoder")


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """Where a trained model comes from.

    Attributes:
        dataset_sha256: of the recording that it was trained on.
        weights_sha256: of its tensors.
        metrics, versions, config: of the training, as a bundle's manifest has them.
    """

    dataset_sha256: str
    weights_sha256: str
    metrics: Mapping[str, Any]
    versions: Mapping[str, str]
    config: Mapping[str, Any]

    def training(self) -> dict[str, Any]:
        """What goes into a manifest besides the hashes, which have fields of their own there."""
        return {"metrics": self.metrics, "versions": self.versions, "config": self.config}


@dataclass(frozen=True, kw_only=True, eq=False)
class TrainedModel:
    """A verified model directory.

    Attributes:
        states: tensors of the networks `NETWORKS`, each named as in its own state dict.
        scaling: of the slim encoder's sensors, in their order.
        sensors: their names.
        config: all settings of the training.
    """

    states: Mapping[str, State]
    scaling: Scaling
    sensors: tuple[str, ...]
    config: Config
    provenance: Provenance

    def program(self, mpc: MpcConfig) -> ControllerProgram:
        """The controller with these optimiser settings; raises ExportError if the weights do not fit."""
        return ControllerProgram.from_state(
            encoder=self.states["slim"],
            dynamics=self.states["dynamics"],
            decoder=self.states["decoder"],
            scaling=self.scaling,
            mpc=mpc,
            action_limit=self.config.flow.action_limit,
            sensors=self.sensors,
            window=self.config.model.window,
        )


def load_trained(directory: Path) -> TrainedModel:
    """Read and verify a model directory.

    Raises:
        ExportError: a file is missing, damaged, of another schema, or the weights are not those that the
            description was written for; the message names the file and the entry.
    """
    body = _read_description(directory / DESCRIPTION)
    try:
        raw = (directory / WEIGHTS).read_bytes()
    except OSError as error:
        raise ExportError(f"{directory / WEIGHTS}: {error.strerror or error}") from error
    try:
        if hashlib.sha256(raw).hexdigest() != body["weights_sha256"]:
            raise ExportError(f"{directory / WEIGHTS}: SHA-256 does not match {DESCRIPTION}")
        sensors = tuple(body["sensors"])
        return TrainedModel(
            states=_split(directory / WEIGHTS, safetensors.numpy.load(raw)),
            scaling=_select(directory / DESCRIPTION, body["scaling"], sensors),
            sensors=sensors,
            config=from_tree(body["config"]),
            provenance=Provenance(
                **{key: body[key] for key in ("dataset_sha256", "weights_sha256", "metrics", "versions", "config")}
            ),
        )
    except KeyError as error:
        raise ExportError(f"{directory / DESCRIPTION}: {error.args[0]!r} is missing") from error
    except (ConfigError, dacite.DaciteError, TypeError) as error:
        raise ExportError(f"{directory / DESCRIPTION}: {error}") from error
    except (safetensors.SafetensorError, ValueError) as error:
        raise ExportError(f"{directory / WEIGHTS}: not a safetensors file ({error})") from error


def _read_description(path: Path) -> dict[str, Any]:
    try:
        body = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ExportError(f"{path}: {error.strerror or error}") from error
    except ValueError as error:
        raise ExportError(f"{path}: not JSON ({error})") from error
    schema = body.get("schema") if isinstance(body, dict) else None
    if not isinstance(body, dict) or schema != SCHEMA:
        raise ExportError(f"{path}: schema {schema!r}, this version reads {SCHEMA!r}")
    return body


def _split(path: Path, tensors: Mapping[str, npt.NDArray[Any]]) -> dict[str, dict[str, npt.NDArray[Any]]]:
    slim = {f"slim_{network}": network for network in _SLIMMED}
    states: dict[str, dict[str, npt.NDArray[Any]]] = {network: {} for network in (*NETWORKS, _TEACHER, *slim)}
    for key, tensor in tensors.items():
        network, _, name = key.partition(".")
        if network not in states:
            raise ExportError(f"{path}: unknown tensor {key}")
        states[network][name] = tensor
    for stored, network in slim.items():
        if states[stored]:
            states[network] = states[stored]
    return {network: states[network] for network in NETWORKS}


def _select(path: Path, tree: Mapping[str, Any], sensors: tuple[str, ...]) -> Scaling:
    whole = dacite.from_dict(Scaling, tree, config=dacite.Config(strict=True, cast=[tuple]))
    for name in ("pressure_mean", "pressure_std"):
        if len(getattr(whole, name)) != sensor_facts.COUNT:
            raise ExportError(
                f"{path}: scaling.{name} has {len(getattr(whole, name))} values, not {sensor_facts.COUNT}"
            )
    chosen = sensor_facts.indices(sensors)
    return Scaling(
        pressure_mean=tuple(np.array(whole.pressure_mean)[chosen].tolist()),
        pressure_std=tuple(np.array(whole.pressure_std)[chosen].tolist()),
        action_std=whole.action_std,
        force_mean=whole.force_mean,
        force_std=whole.force_std,
    )
