"""A trained model's networks, and functions that write and read its folder (`contract.model.model_folder`)."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import nn

from contract.arrays import Array
from contract.config.tree import Config
from contract.errors import ConfigError, ModelError
from contract.model import model_folder
from contract.model.model_folder import DESCRIPTION, MODEL_WEIGHTS, PRIOR, Description, Tensors
from contract.release.manifest import Scaling
from contract.sensor_layout import SensorLayout
from contract.sensors import TRUCK
from contract.typed import typed, untyped
from train.distillation.evaluate import ModelMetrics
from train.networks.model import Encoder, Predictor, WakeModel
from train.selection.shap_ranking import SensorChoice


@dataclass(frozen=True, kw_only=True, eq=False)
class TrainedModel:
    """The networks on the CPU in evaluation mode, and their provenance (`contract.model.model_folder.Description`).

    Attributes:
        teacher, slim: networks with all sensors, in the order of `layout`, and encoder on `sensors`, in their order.
        predictor: narrower dynamics and decoder for the vehicle; None if the vehicle uses the teacher's networks.
        prior: tensors of the plan's prior by name (`train.refinement`); None if the model is not refined.
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
    layout: SensorLayout = TRUCK
    prior: Mapping[str, Array] | None = None


def save(path: Path, model: TrainedModel) -> None:
    """Write or replace the model folder. Raises StillwakeError if the folder cannot be written or is no model."""
    description = Description(
        config=model.config,
        scaling=model.scaling,
        sensors=model.sensors,
        dataset_sha256=model.dataset_sha256,
        metrics=untyped(model.metrics),
        ranking=untyped(model.ranking),
        versions=model.versions,
        layout=model.layout,
    )
    weights = _weights(_parts(model.teacher, model.slim, model.predictor))
    of_prior = {f"{PRIOR}.{key}": value for key, value in (model.prior or {}).items()}
    model_folder.write(path, description, {k: v.detach().cpu().numpy() for k, v in weights.items()} | of_prior)


def load(path: Path) -> TrainedModel:
    """Read and verify a model folder. Raises ModelError if the folder is invalid (`contract.model.model_folder.read`),
    or if a weight does not fit the networks of the folder's configuration; the message names the weight."""
    folder = model_folder.read(path)
    about = folder.description
    config = about.config
    teacher, slim = WakeModel(len(about.layout), config.model), Encoder(len(about.sensors), config.model)
    predictor = Predictor(config.model.slim) if config.model.is_slimmed else None
    prior = folder.network(PRIOR)
    networks = {name: value for name, value in folder.tensors.items() if not name.startswith(f"{PRIOR}.")}
    _fill(path, _parts(teacher, slim, predictor), networks)
    try:
        metrics, ranking = typed(about.metrics, ModelMetrics), typed(about.ranking, SensorChoice)
    except ConfigError as error:
        raise ModelError(f"model {path}: {DESCRIPTION}: {error}") from error
    return TrainedModel(
        config=config,
        scaling=about.scaling,
        teacher=teacher.eval(),
        slim=slim,
        predictor=None if predictor is None else predictor.eval(),
        sensors=about.sensors,
        dataset_sha256=about.dataset_sha256,
        metrics=metrics,
        ranking=ranking,
        versions=about.versions,
        layout=about.layout,
        prior=prior or None,
    )


def _parts(teacher: WakeModel, slim: Encoder, predictor: Predictor | None) -> Mapping[str, nn.Module]:
    parts: dict[str, nn.Module] = dict(teacher.named_children())
    parts["slim"] = slim
    if predictor is not None:
        parts |= {f"slim_{name}": network for name, network in predictor.named_children()}
    return parts


def _weights(parts: Mapping[str, nn.Module]) -> dict[str, torch.Tensor]:
    return {f"{name}.{key}": value for name, part in parts.items() for key, value in part.state_dict().items()}


def _fill(path: Path, parts: Mapping[str, nn.Module], tensors: Tensors) -> None:
    expected = _weights(parts)
    for key in sorted(expected.keys() | tensors.keys()):
        where = f"model {path}: {MODEL_WEIGHTS}: {key}"
        if key not in tensors or key not in expected:
            raise ModelError(f"{where} is {'missing' if key in expected else 'not expected'}")
        if (shape := tuple(tensors[key].shape)) != (needed := tuple(expected[key].shape)):
            raise ModelError(f"{where} has shape {shape}, but the configuration needs {needed}")
    for name, network in parts.items():
        network.load_state_dict({key: torch.tensor(tensors[f"{name}.{key}"]) for key in network.state_dict()})
        network.eval()
