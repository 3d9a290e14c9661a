"""A model as `train` writes it, with networks as they were drawn."""

import torch

from contract.config.tree import Config
from contract.release.manifest import Scaling
from contract.sensor_layout import SensorLayout
from contract.sensors import TRUCK
from train.distillation.evaluate import EncoderMetrics, ForceError, ModelMetrics, RolloutError
from train.model_store import TrainedModel
from train.networks.model import Encoder, WakeModel
from train.selection.shap_ranking import GIVEN, SensorChoice


def untrained(
    config: Config, scaling: Scaling, sensors: tuple[str, ...], layout: SensorLayout = TRUCK, digest: str = "d" * 64
) -> TrainedModel:
    torch.manual_seed(0)
    force = ForceError(r2=0.9, l1_over_sigma=0.2)
    errors = EncoderMetrics(drag=force, lift=force, rollout=(RolloutError(horizon=5, latent=0.1, drag=0.2, lift=0.3),))
    return TrainedModel(
        config=config,
        scaling=scaling,
        teacher=WakeModel(len(layout), config.model).eval(),
        slim=Encoder(len(sensors), config.model).eval(),
        predictor=None,
        sensors=sensors,
        dataset_sha256=digest,
        metrics=ModelMetrics(teacher=errors, slim=errors, slim_latent=0.1),
        ranking=SensorChoice(method=GIVEN, order=sensors),
        versions={},
        layout=layout,
    )
