"""A streamed joint fit reads stretches, and its finish windows."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace

import pytest
import torch

from contract.config.tree import Config
from train.fitting.fit import fit_joint
from train.fitting.progress import Phase
from train.networks.model import Encoder
from train.samples.rows import Rows


def test_the_two_readings_agree_on_a_stretch_s_first_window_alone(small_config: Config) -> None:
    torch.manual_seed(3)
    encoder = Encoder(5, small_config.model)
    stretches = torch.randn(4, small_config.model.window + 6, 6)
    with torch.no_grad():
        streamed, windows = encoder.encode_stream(stretches), encoder.encode_segments(stretches)
    assert streamed.shape == windows.shape == (4, 7, small_config.model.latent)
    torch.testing.assert_close(streamed[:, 0], windows[:, 0], rtol=1e-4, atol=1e-5)
    assert (streamed[:, 1:] - windows[:, 1:]).abs().amax() > 1e-3


def test_the_fit_streams_and_the_finish_does_not(
    rows: Rows, small_config: Config, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: Counter[str] = Counter()

    def count(name: str) -> None:
        inner = getattr(Encoder, name)

        def counted(self: Encoder, segments: torch.Tensor) -> torch.Tensor:
            calls[name] += 1
            found: torch.Tensor = inner(self, segments)
            return found

        monkeypatch.setattr(Encoder, name, counted)

    count("encode_stream")
    count("encode_segments")
    steps: dict[Phase, int] = {}

    def progress(phase: Phase, step: int, total: int, terms: Mapping[str, float]) -> None:
        steps[phase] = step

    settings = replace(
        small_config.train,
        epochs=2.0, streamed=True, finish=replace(small_config.train.finish, epochs=1.0, unroll=8),
    )  # fmt: skip
    fit_joint(rows, replace(small_config, train=settings), progress=progress)
    assert calls == {"encode_stream": steps[Phase.FIT], "encode_segments": steps[Phase.FINISH]}
