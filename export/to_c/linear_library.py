"""The C99 library of a linear controller: the sources in `sources/linear`, and its numbers."""

from typing import Final

import numpy as np

from export.program.float32 import float32_within
from export.program.linear_program import LinearProgram
from export.to_c.library import ALIGNMENTS, linear_sources, shared_settings, weights_files

OUTPUTS_AT_A_TIME: Final = 4
"""As the sources compute them."""


def linear_c_library(program: LinearProgram) -> dict[str, bytes]:
    """All files of the library by name. Raises ExportError for a value that float32 cannot hold; the message
    names it."""
    definitions = {
        **shared_settings(program, "float32"),
        "SW_DIFFERENCES": program.pairs,
        "SW_PRODUCTS": program.products,
    }
    outputs = np.vstack([program.model.reshape(-1, program.gain.size), program.gain.reshape(1, -1)])
    filled = np.pad(outputs, [(0, -len(outputs) % OUTPUTS_AT_A_TIME), (0, 0)])
    arrays = {
        "sw_window_mean": np.array(program.scaling.window_mean),
        "sw_force_mean": np.array(program.scaling.force_mean),
        "sw_force_std": np.array(program.scaling.force_std),
        "sw_action_limit": np.array(float32_within(program.action_limit)),
        "sw_drag_reference": np.array(program.mpc.drag_reference),
        "sw_by_history": filled[:, :-1].T,
        "sw_by_action": filled[:, -1],
        "sw_default_weights": np.array(program.mpc.weights.as_tuple()),
    }
    return linear_sources() | weights_files(arrays, definitions, ALIGNMENTS["float32"])
