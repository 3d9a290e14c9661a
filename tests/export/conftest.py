"""What a trained model carries with its networks, as small as it may be."""

import pytest

from train.distillation.evaluate import EncoderMetrics, ForceError, ModelMetrics, RolloutError


@pytest.fixture(scope="session")
def metrics() -> ModelMetrics:
    force = ForceError(r2=0.9, l1_over_sigma=0.2)
    encoder = EncoderMetrics(drag=force, lift=force, rollout=(RolloutError(horizon=5, latent=0.1, drag=0.2, lift=0.3),))
    return ModelMetrics(teacher=encoder, slim=encoder, slim_latent=0.1)
