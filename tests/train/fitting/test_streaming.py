"""A state carried along is the plain recurrence over the whole episode, and a student can be trained for it."""

from dataclasses import replace

import pytest
import torch

from train.fitting.fit import fit_joint
from train.fitting.progress import Phase
from train.networks.model import Encoder


@pytest.mark.slow
def test_the_fit_streams_and_the_finish_does_not(rows, small_config, monkeypatch):
    def refuse(encoder: Encoder, segments: torch.Tensor) -> torch.Tensor:
        raise AssertionError(segments.shape)

    finish = replace(small_config.train.finish, epochs=1.0, unroll=8)
    settings = replace(small_config.train, epochs=2.0, streamed=True, finish=finish)
    for name, phases in (("encode_stream", set()), ("encode_segments", {Phase.FIT})):
        seen: set[Phase] = set()
        with monkeypatch.context() as patch, pytest.raises(AssertionError):
            patch.setattr(Encoder, name, refuse)
            fit_joint(rows, replace(small_config, train=settings), progress=lambda phase, *_, to=seen: to.add(phase))
        assert seen == phases, name
