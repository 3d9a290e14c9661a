"""Windows drawn from a recording at random."""

import numpy as np
import torch
from torch import Tensor

from contract.arrays import Index
from train.samples.rows import Rows


def first_rows(rows: Rows, window: int) -> Index:
    """Index of the first row of every full window."""
    return np.concatenate([np.arange(span.start, span.stop - window + 1) for span in rows.spans()])


def windows_at(rows: Rows, firsts: Index, window: int) -> Tensor:
    """The windows that begin at those rows, (n, L, F)."""
    start = torch.as_tensor(firsts, device=rows.inputs.device)
    return rows.inputs[start[:, None] + torch.arange(window, device=start.device)]
