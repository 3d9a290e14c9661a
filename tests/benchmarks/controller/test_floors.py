"""The floors of a control step: its work, counted by hand, over what a core does."""

from benchmarks.controller.floors import CoreLimits, Work
from benchmarks.controller.latency import over_floors
from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig
from examples.random_programs import random_program


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


def test_the_floor_is_the_larger_of_arithmetic_and_memory():
    names = ("eager_ms", "onnx_ms", "onnx_int8_ms", "c_ms", "c_int8_ms")
    for bytes_per_s, float_ms, int8_ms in ((1e12, 2.0, 0.5), (4e9, 2.0, 0.5), (1e9, 4.0, 1.0)):
        core = CoreLimits(float_macs_per_s=1e9, integer_macs_per_s=4e9, bytes_per_s=bytes_per_s)
        floors = over_floors(core, Work(macs=2_000_000, weights_read=1_000_000), dict.fromkeys(names, 8.0))
        assert floors["floor_ms"] == dict.fromkeys(names, float_ms) | {"c_int8_ms": int8_ms}, bytes_per_s
        assert floors["over_floor"]["c_int8_ms"] == 8.0 / int8_ms, bytes_per_s
