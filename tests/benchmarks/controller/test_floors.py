"""The floors of a control step: its work, counted by hand, over what a core does."""

import pytest

from benchmarks.controller.floors import CoreLimits, Work, measure_core
from benchmarks.controller.latency import over_floors
from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig
from export.program.random_program import random_program
from firmware_sim.in_c.compiler import host_compiler


def test_the_work_of_a_small_program_is_what_counting_gives():
    sizes = ModelConfig(window=5, latent=3, lstm_width=4, dynamics_width=10, decoder_width=8, decoder_blocks=2)
    program = random_program(0, model=sizes, mpc=MpcConfig(horizon=7, iterations=2))
    encoder = 5 * (16 * 5 + 16 * 4)
    head = program.encoder.hidden.weight.size + program.encoder.output.weight.size
    dynamics, decoder = 4 * 10 + 10 * 10 + 10 * 3, 3 * 8 + 2 * 8 * 8 + 8 * 2
    # Two roll-outs and two adjoints, then the roll-out of the result.
    assert Work.of(program) == Work(
        macs=encoder + head + 5 * 7 * (dynamics + decoder),
        weights_read=encoder + head + 5 * (7 * dynamics + decoder),
    )


@pytest.mark.parametrize(("bytes_per_s", "float_ms", "int8_ms"), [(1e12, 2.0, 0.5), (4e9, 2.0, 0.5), (1e9, 4.0, 1.0)])
def test_the_floor_is_the_larger_of_arithmetic_and_memory(bytes_per_s, float_ms, int8_ms):
    core = CoreLimits(float_macs_per_s=1e9, integer_macs_per_s=4e9, bytes_per_s=bytes_per_s)
    names = ("eager_ms", "onnx_ms", "onnx_int8_ms", "c_ms", "c_int8_ms")
    found = over_floors(core, Work(macs=2_000_000, weights_read=1_000_000), dict.fromkeys(names, 8.0))
    assert found["floor_ms"] == dict.fromkeys(names, float_ms) | {"c_int8_ms": int8_ms}
    assert found["over_floor"]["c_int8_ms"] == 8.0 / int8_ms


@pytest.mark.compiler
def test_a_core_multiplies_more_often_than_it_reads_and_both_in_a_plausible_range():
    core = measure_core(20_000, host_compiler())
    # From a slow virtual machine to eight 512-bit fused products a cycle at 6 GHz; less is a loop that timed nothing,
    # more is one that a compiler took out.
    for rate in (core.float_macs_per_s, core.integer_macs_per_s, core.bytes_per_s / 4):
        assert 1e7 < rate < 8e11
