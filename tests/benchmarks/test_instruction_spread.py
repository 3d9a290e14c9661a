"""The work of a control step does not depend on its data, and a library whose work does is found."""

from typing import Final

import numpy as np
import pytest

from benchmarks.controller.mcu import instruction_spread
from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig
from contract.errors import McuError
from examples.random_programs import random_program
from export.program.windows import random_window
from export.release.lowering import int8_library

pytestmark = pytest.mark.mcu

END: Final = b"    return finite ? SW_OK : SW_NOT_FINITE;"
PROGRAM: Final = random_program(
    0,
    model=ModelConfig(window=6, latent=3, lstm_width=5, dynamics_width=12, decoder_width=8),
    mpc=MpcConfig(horizon=6, iterations=2),
)


def windows(count: int) -> list[np.ndarray]:
    rng = np.random.default_rng(0)
    return [random_window(PROGRAM, rng) for _ in range(count)]


@pytest.fixture(scope="module")
def sources() -> dict[str, bytes]:
    return int8_library(PROGRAM, windows(4))


@pytest.mark.proofs  # of a benchmark
def test_the_work_does_not_depend_on_the_data_and_work_that_does_is_found(sources):
    """What conditions skip counts as run, so that the comparisons of the cost do not show."""
    spread = instruction_spread(sources, windows(10))
    assert (spread["windows"], spread["most"], spread["unlike"]) == (10, spread["fewest"], 0)
    assert spread["fewest"] > 10_000
    loop = (
        b"    if (input->window[0][0] > -0.3f) {\n        for (volatile int i = 0; i < 50; i++) {\n        }\n    }\n"
    )
    step = sources["sw_control_step.c"]
    assert END in step
    spread = instruction_spread(sources | {"sw_control_step.c": step.replace(END, loop + END)}, windows(10))
    assert spread["most"] - spread["fewest"] >= 50
    assert 0 < spread["unlike"] < 10
    with pytest.raises(McuError, match="no windows"):
        instruction_spread(sources, [])
