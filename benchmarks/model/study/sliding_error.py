"""Where along a recording a model errs (paper, appendix A)."""

import torch
from torch import Tensor

from contract.errors import ConfigError


def sliding_error(decoded: Tensor, reference: Tensor, width: int) -> Tensor:
    """L1/sigma within each run of `width` consecutive samples, (n - width + 1, 2) of (n, 2) forces.

    Sigma is that of the whole reference, as in the paper's figure: a local one would be small where the wake is calm.

    Raises:
        ConfigError: if there are fewer samples than `width`.
    """
    if not 1 <= width <= len(reference):
        raise ConfigError(f"sliding window of {width} samples: must be from 1 to the {len(reference)} there are")
    error = (decoded - reference).abs().double()
    running = torch.cat([error.new_zeros(1, 2), error.cumsum(dim=0)])
    return (running[width:] - running[:-width]) / width / reference.double().std(dim=0, correction=0)
