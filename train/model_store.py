"""A trained model on disk: a directory of `model.safetensors` and `model.json`, whole or not there.

`model.safetensors` holds the weights under `encoder.`, `slim.`, `dynamics.` and `decoder.`, and where the
configuration asks for narrower ones, under `slim_dynamics.` and `slim_decoder.`; `model.json` holds what they assume
and where they come from:

    schema, config (all settings), scaling (contract.release.bundle.Scaling),
    sensors (the slim encoder's inputs in order),
    dataset_sha256, weights_sha256, metrics, ranking, versions
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

import dacite
import safetensors
import safetensors.torch
from torch import Tensor, nn

from contract import sensors as sensor_facts
from contract.atomic import replacing
from contract.config.loading import from_tree, to_tree
from contract.config.tree import Config
from contract.errors import ConfigError, StillwakeError
from contract.release.bundle import Scaling
from train.evaluate import ModelMetrics
from train.model import Encoder, Predictor, WakeModel
from train.selection.choice import SensorChoice

SCHEMA: Final = "stillwake-model/1"
WEIGHTS: Final = "model.safetensors"
DESCRIPTION: Final = "model.json"


class ModelError(StillwakeError):
    """A model directory that is incomplete, of another schema, or altered."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TrainedModel:
    """Networks on the CPU in evaluation mode, and their provenance.

    Attributes:
        teacher: encoder on all 90 sensors, dynamics and decoder.
        slim: encoder on `sensors`.
        predictor: narrower dynamics and decoder for the vehicle; None where the teacher's serve there.
        sensors: names, in the order of the slim encoder's inputs.
        scaling: of all 90 pressures, the action and the forces.
        metrics: on the test episodes.
        ranking: how the sensors were chosen.
        versions: of the software.
    """

    config: Config
    scaling: Scaling
    teacher: WakeModel
    slim: Encoder
    predictor: Predictor | None
    sensors: tuple[str, ...]
    dataset_sha256: str
    metrics: ModelMetrics
    ranking: SensorChoice
    versions: Mapping[str, str]

    @property
    def deployed(self) -> Predictor | WakeModel:
        """The dynamics and decoder that go on the vehicle."""
        return self.teacher if self.predictor is None else self.predictor


def save(path: Path, model: TrainedModel) -> None:
    """Write the directory, replacing a model that is there.

    Raises:
        StillwakeError: if the place cannot be written or holds something that is not a model.
    """
    check_free(path)
    weights = safetensors.torch.save(_tensors(model))
    body = {
        "schema": SCHEMA,
        "config": to_tree(model.config),
        "scaling": asdict(model.scaling),
        "sensors": model.sensors,
        "dataset_sha256": model.dataset_sha256,
        "weights_sha256": hashlib.sha256(weights).hexdigest(),
        "metrics": model.metrics.as_tree(),
        "ranking": model.ranking.as_tree(),
        "versions": model.versions,
    }
    with replacing(path) as temporary:
        temporary.mkdir()
        (temporary / WEIGHTS).write_bytes(weights)
        (temporary / DESCRIPTION).write_text(json.dumps(body, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def check_free(path: Path) -> None:
    """Raise StillwakeError if writing a model to `path` would replace anything but a model."""
    if path.is_dir() and ((path / DESCRIPTION).is_file() or not any(path.iterdir())):
        return
    if path.exists():
        raise StillwakeError(f"{path}: exists and is not a model directory; choose another place")


def load(path: Path) -> TrainedModel:
    """Read and verify a model directory.

    Raises:
        ModelError: if a file is missing, damaged, altered or of another schema, or the weights are not those of
            the networks the description configures; the message names it.
    """
    try:
        body = json.loads((path / DESCRIPTION).read_text(encoding="utf-8"))
        raw = (path / WEIGHTS).read_bytes()
    except (OSError, ValueError) as error:
        raise ModelError(f"model {path}: cannot be read ({error})") from error
    if not isinstance(body, dict) or body.get("schema") != SCHEMA:
        found = body.get("schema") if isinstance(body, dict) else None
        raise ModelError(f"model {path}: schema {found!r}, this version reads {SCHEMA!r}")
    try:
        if hashlib.sha256(raw).hexdigest() != body["weights_sha256"]:
            raise ModelError(f"model {path}: {WEIGHTS} was altered (SHA-256 does not match {DESCRIPTION})")
        config = from_tree(body["config"])
        names = tuple(body["sensors"])
        sensor_facts.indices(names)
        scaling = dacite.from_dict(Scaling, body["scaling"], config=dacite.Config(strict=True, cast=[tuple]))
        _check_lengths(path, scaling)
        teacher, slim = WakeModel(sensor_facts.COUNT, config.model), Encoder(len(names), config.model)
        predictor = Predictor(config.model.slim) if config.model.is_slimmed else None
        _fill(path, _parts(teacher, slim, predictor), safetensors.torch.load(raw))
        return TrainedModel(
            config=config,
            scaling=scaling,
            teacher=teacher.eval(),
            slim=slim,
            predictor=None if predictor is None else predictor.eval(),
            sensors=names,
            dataset_sha256=body["dataset_sha256"],
            metrics=ModelMetrics.from_tree(body["metrics"]),
            ranking=SensorChoice.from_tree(body["ranking"]),
            versions=body["versions"],
        )
    except KeyError as error:
        raise ModelError(f"model {path}: {DESCRIPTION} lacks {error}") from error
    except (dacite.DaciteError, ConfigError, TypeError) as error:
        raise ModelError(f"model {path}: {DESCRIPTION}: {error}") from error
    except safetensors.SafetensorError as error:
        raise ModelError(f"model {path}: {WEIGHTS} is damaged ({error})") from error


def _parts(teacher: WakeModel, slim: Encoder, predictor: Predictor | None) -> Mapping[str, nn.Module]:
    """Every network by the name its weights are stored under."""
    parts: dict[str, nn.Module] = dict(teacher.named_children())
    parts["slim"] = slim
    if predictor is not None:
        parts |= {f"slim_{name}": network for name, network in predictor.named_children()}
    return parts


def _tensors(model: TrainedModel) -> dict[str, Tensor]:
    parts = _parts(model.teacher, model.slim, model.predictor)
    return {
        f"{name}.{key}": value.detach().cpu().contiguous()
        for name, network in parts.items()
        for key, value in network.state_dict().items()
    }


def _fill(path: Path, parts: Mapping[str, nn.Module], tensors: Mapping[str, Tensor]) -> None:
    expected = {f"{name}.{key}": value for name, part in parts.items() for key, value in part.state_dict().items()}
    for key in sorted(expected.keys() | tensors.keys()):
        if key not in tensors or key not in expected:
            raise ModelError(f"model {path}: {WEIGHTS}: {key} is {'missing' if key in expected else 'not expected'}")
        if tensors[key].shape != expected[key].shape:
            found, wanted = tuple(tensors[key].shape), tuple(expected[key].shape)
            raise ModelError(f"model {path}: {WEIGHTS}: {key} has shape {found}, the configuration needs {wanted}")
    for name, network in parts.items():
        network.load_state_dict({key: tensors[f"{name}.{key}"] for key in network.state_dict()})
        network.eval()


def _check_lengths(path: Path, scaling: Scaling) -> None:
    for name, wanted in (("pressure_mean", sensor_facts.COUNT), ("pressure_std", sensor_facts.COUNT)):
        if len(getattr(scaling, name)) != wanted:
            raise ModelError(f"model {path}: scaling.{name} has {len(getattr(scaling, name))} values, not {wanted}")
    for name in ("force_mean", "force_std"):
        if len(getattr(scaling, name)) != 2:
            raise ModelError(f"model {path}: scaling.{name} has {len(getattr(scaling, name))} values, not 2")
