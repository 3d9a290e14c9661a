"""What is said of a control step's cost: modelled cycles add up, and the streamed encoder's share is the sizes'."""

from benchmarks.controller.operations.chosen import RELEASE
from benchmarks.controller.operations.measure import encoder, modelled_cycles
from contract.config.controller import MpcConfig
from export.program.random_program import random_program

PROGRAM = random_program(0, mpc=MpcConfig(iterations=3))
CYCLES = {"row": 10.0, "iteration": 1000.0, "rest": 300.0}


def test_cycles_of_the_release_are_what_they_were_taken_from():
    assert modelled_cycles(RELEASE, PROGRAM, CYCLES) == 32 * 10.0 + 3 * 1000.0 + 300.0


def test_a_row_of_the_encoder_is_its_gates_products():
    found = encoder(PROGRAM, CYCLES)
    assert found["streamed"] == 4 * 64 * (len(PROGRAM.sensors) + 1 + 64)
    assert found["window"] == 32 * found["streamed"]
    assert found["saved_share"] == 31 * found["streamed"] / RELEASE.multiply_accumulates(PROGRAM)
