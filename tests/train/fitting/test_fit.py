"""Training learns, repeats itself, streams, and goes on after an interruption as if there had been none."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest
import torch

from contract.config.learning import FinishConfig
from contract.config.tree import Config
from contract.errors import ConfigError, DatasetError, StillwakeError, TrainingError
from train.fitting.fit import fit_joint
from train.fitting.progress import Phase
from train.fitting.unfinished import Checkpoints, Identity
from train.networks.model import Encoder

pytestmark = pytest.mark.slow  # networks are trained

IDENTITY = Identity(settings="{}", dataset_sha256="0" * 64)


def trained(config: Config, **changes: Any) -> Config:
    return replace(config, train=replace(config.train, **changes))


def test_a_seed_makes_a_run_and_leaves_the_caller_s_alone(rows, small_config):
    torch.manual_seed(11)
    expected = torch.rand(3)
    torch.manual_seed(11)
    one = fit_joint(rows, small_config)
    assert torch.equal(torch.rand(3), expected)
    other = fit_joint(rows, trained(small_config, seed=1))
    assert not torch.equal(one.encoder.output.weight, other.encoder.output.weight)


def test_a_checkpoint_of_another_run_is_refused(rows, small_config, tmp_path):
    kept = Checkpoints(folder=tmp_path, identity=IDENTITY)
    fit_joint(rows, small_config, checkpoints=kept)
    with pytest.raises(ConfigError, match=r"fit\.pt was made with other settings"):
        fit_joint(rows, small_config, checkpoints=replace(kept, identity=replace(IDENTITY, settings="[]")))
    with pytest.raises(DatasetError, match=r"fit\.pt was made from another recording"):
        fit_joint(rows, small_config, checkpoints=replace(kept, identity=replace(IDENTITY, dataset_sha256="1")))
    kept.path(Phase.FIT).write_bytes(kept.path(Phase.FIT).read_bytes()[:1000])
    with pytest.raises(StillwakeError, match=r"fit\.pt is damaged"):
        fit_joint(rows, small_config, checkpoints=kept)


def test_a_loss_that_is_not_finite_ends_the_training_at_once(rows, small_config, tmp_path):
    config = trained(small_config, learning_rate=1e12, epochs=12.0)
    kept = Checkpoints(folder=tmp_path / "model.checkpoints", identity=IDENTITY, every=1)
    message = r"^joint fit: .* not finite after \d+ of \d+ iterations with train.learning_rate = 1e\+12: choose a lower"
    with pytest.raises(TrainingError, match=message):
        fit_joint(rows, config, checkpoints=kept, progress=lambda *_: pytest.fail("went on"))
    assert list(tmp_path.iterdir()) == []


def test_the_finish_lengthens_the_unroll_and_a_resume_goes_on_inside_it(rows, small_config, tmp_path):
    config = trained(small_config, epochs=2.0, finish=FinishConfig(epochs=4.0, unroll=9))
    whole = fit_joint(rows, config)
    unfinished = fit_joint(rows, trained(config, finish=FinishConfig()))
    assert not torch.equal(whole.dynamics.output.weight, unfinished.dynamics.output.weight)
    kept = Checkpoints(folder=tmp_path, identity=IDENTITY, every=7)

    def stop_at_ten(phase: Phase, step: int, total: int, terms: Mapping[str, float]) -> None:
        if phase == Phase.FINISH and step >= 10:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fit_joint(rows, config, progress=stop_at_ten, checkpoints=kept)
    went_on = list[tuple[Phase, int]]()
    resumed = fit_joint(rows, config, progress=lambda *now: went_on.append(now[:2]), checkpoints=kept)
    assert went_on[0] == (Phase.FINISH, 10), "it went on from step 7"
    for (name, a), b in zip(whole.state_dict().items(), resumed.state_dict().values(), strict=True):
        assert torch.equal(a, b), name


def test_the_fit_streams_and_the_finish_does_not(rows, small_config, monkeypatch):
    def refuse(encoder: Encoder, segments: torch.Tensor) -> torch.Tensor:
        raise AssertionError(segments.shape)

    config = trained(small_config, epochs=2.0, streamed=True, finish=FinishConfig(epochs=1.0, unroll=8))
    for name, phases in (("encode_stream", set()), ("encode_segments", {Phase.FIT})):
        seen: set[Phase] = set()
        with monkeypatch.context() as patch, pytest.raises(AssertionError):
            patch.setattr(Encoder, name, refuse)
            fit_joint(rows, config, progress=lambda phase, *_, to=seen: to.add(phase))
        assert seen == phases, name
