"""The gates: every lowering passes through its own, and one that is another program's passes none."""

from dataclasses import replace

import pytest

from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig
from contract.errors import ExportError
from examples.random_programs import random_program
from export.gates.quantisation import QuantisationLimits
from export.int8.calibrate import rounded_on
from export.program.random_windows import random_windows
from export.release.gated import gate
from export.release.lowering import library_of, lower
from firmware_sim.in_c.host_library import CController

MODEL = ModelConfig(window=5, latent=3, lstm_width=5, dynamics_width=10, decoder_width=8)
MPC = MpcConfig(horizon=6)
PROGRAM, OTHER = random_program(0, model=MODEL, mpc=MPC), random_program(1, model=MODEL, mpc=MPC)
WINDOWS = random_windows(PROGRAM, 30)
LOOSE = QuantisationLimits(rms_action_error=2e-3, max_cost_gap=0.01)


def test_rounding_that_changes_too_much_is_refused():
    lowered = lower(rounded_on(PROGRAM, WINDOWS), calibration=WINDOWS, with_library=False)
    with pytest.raises(ExportError, match=r"int8 weights: rms_action_error is .*, at most 1e-15 is allowed"):
        gate(lowered, WINDOWS[:3], QuantisationLimits(rms_action_error=1e-15))


@pytest.mark.proofs  # gates a release once more
@pytest.mark.compiler  # compiles two libraries
def test_an_int8_library_of_another_program_is_refused():
    rounded = rounded_on(PROGRAM, WINDOWS)
    library = library_of(rounded_on(OTHER, WINDOWS), WINDOWS)
    lowered = replace(lower(rounded, calibration=WINDOWS, with_library=False), library=library)
    with pytest.raises(ExportError, match="int8 C library: "):
        gate(lowered, WINDOWS[:3], LOOSE, compiled=CController)
