"""What more than one room's tests need."""

from datetime import date
from pathlib import Path

import pytest

from contract.config import Config, ModelConfig, MpcConfig


@pytest.fixture(scope="session")
def random_release(tmp_path_factory) -> Path:
    """A bundle that is one in every respect but that nobody trained it: int8, the paper's window, small otherwise."""
    from export.bundle_writer import write_release
    from export.quantisation_gate import QuantisationLimits
    from export.random_program import random_program

    path = tmp_path_factory.mktemp("release") / "bundle"
    model = ModelConfig(latent=3, lstm_width=8, dynamics_width=16, decoder_width=8)
    config = Config()
    write_release(
        path,
        random_program(1, model=model, mpc=MpcConfig(horizon=8)),
        precision="int8",
        name="random",
        operating_point=config.operating_point,
        budget_ms=config.period_ns / 1e6,
        compute_time_ms=config.ecu.compute_time_ms,
        control_period=config.flow.control_period,
        created=date(2026, 1, 2),
        dataset_sha256="0" * 64,
        weights_sha256="0" * 64,
        provenance={},
        limits=QuantisationLimits(rms_action_error=0.05, max_cost_gap=1.0),
    )
    return path
