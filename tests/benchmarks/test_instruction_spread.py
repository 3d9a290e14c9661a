"""The work of a control step does not depend on its data, and a library whose work does is found."""

import numpy as np
import pytest

from benchmarks.controller.mcu import instruction_spread
from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig
from contract.errors import McuError
from examples.random_programs import random_program
from export.program.controller_program import random_window
from export.to_c.library import int8_library


@pytest.mark.mcu
@pytest.mark.proofs  # of a benchmark
def test_the_work_does_not_depend_on_the_data_and_work_that_does_is_found():
    """What conditions skip counts as run, so that the comparisons of the cost do not show."""
    model = ModelConfig(window=6, latent=3, lstm_width=5, dynamics_width=12, decoder_width=8)
    program, rng = random_program(0, model=model, mpc=MpcConfig(horizon=6, iterations=2)), np.random.default_rng(0)
    windows = [random_window(program, rng) for _ in range(10)]
    sources = int8_library(program, windows[:4])
    spread = instruction_spread(sources, windows)
    assert (spread["windows"], spread["most"], spread["unlike"]) == (10, spread["fewest"], 0)
    assert spread["fewest"] > 10_000
    loop = (
        b"    if (input->window[0][0] > -0.3f) {\n        for (volatile int i = 0; i < 50; i++) {\n        }\n    }\n"
    )
    step, end = sources["sw_control_step.c"], b"    return finite ? SW_OK : SW_NOT_FINITE;"
    assert end in step
    spread = instruction_spread(sources | {"sw_control_step.c": step.replace(end, loop + end)}, windows)
    assert spread["most"] - spread["fewest"] >= 50
    assert 0 < spread["unlike"] < 10
    with pytest.raises(McuError, match="no windows"):
        instruction_spread(sources, [])
