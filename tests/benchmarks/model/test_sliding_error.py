"""The sliding error is a plain mean over each run of samples."""

import pytest
import torch

from benchmarks.model.study.sliding_error import sliding_error
from contract.errors import ConfigError


def test_the_sliding_error_is_the_mean_over_each_run() -> None:
    generator = torch.Generator().manual_seed(0)
    decoded, reference = torch.randn(50, 2, generator=generator), torch.randn(50, 2, generator=generator)
    found = sliding_error(decoded, reference, 7)
    assert found.shape == (44, 2)
    sigma = reference.numpy().std(axis=0)
    expected = (decoded - reference).abs().numpy()[12:19].mean(axis=0) / sigma
    assert found[12].numpy() == pytest.approx(expected, rel=1e-5)
    with pytest.raises(ConfigError, match="sliding window of 51 samples"):
        sliding_error(decoded, reference, 51)
