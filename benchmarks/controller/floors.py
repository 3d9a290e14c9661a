"""The lower limit of a control step's time on this core, computed from the step's arithmetic and its memory traffic.

Two rates are measured with loops that do nothing else, on one thread:

* multiply-accumulates per second: in float32 with a large matrix product in PyTorch, and in integers with products of
  int16 summed in int32 as in the int8 library, with all operands in the first-level cache;
* bytes per second that one core reads when it repeatedly reads an array of the networks' size, as a roll-out does.

No product of a step can be left out. A roll-out step cannot start before the previous one has ended, so each roll-out
step reads the dynamics' weights again. The decoder processes the whole horizon together and reads its weights once per
pass. The encoder reads the LSTM's weights for each row of the window. The lower limit is the larger of the two times
that follow from these rates. Everything else in a step (norms, ELU, cost, Adam, calls) takes additional time.
"""

import ctypes
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import torch

from ecu.in_c.compiler import OPTIMISED, compile_c
from export.program.controller_program import ControllerProgram

_SOURCE: Final = rb"""
#include <stddef.h>
#include <stdint.h>
void integer_products(const int16_t *a, const int16_t *b, size_t count, long times, int32_t *sums);
float read_all(const float *from, size_t count, long times);
void integer_products(const int16_t *a, const int16_t *b, size_t count, long times, int32_t *sums)
{
    const size_t part = count / 4;
    for (long t = 0; t < times; t++) {
        int32_t s0 = 0, s1 = 0, s2 = 0, s3 = 0;
        for (size_t i = 0; i < part; i++) {
            s0 += a[i] * b[i];
            s1 += a[i + part] * b[i];
            s2 += a[i + 2 * part] * b[i];
            s3 += a[i + 3 * part] * b[i];
        }
        sums[t & 7] += s0 + s1 + s2 + s3;
    }
}
float read_all(const float *from, size_t count, long times)
{
    float sums[128] = {0};
    for (long t = 0; t < times; t++) {
        for (size_t i = 0; i < count; i += 128) {
            for (size_t j = 0; j < 128; j++) sums[j] += from[i + j];
        }
        sums[0] *= 0.5f;
    }
    float sum = 0.0f;
    for (size_t j = 0; j < 128; j++) sum += sums[j];
    return sum;
}
"""
_IN_FIRST_LEVEL: Final = 4096
"""Number of operands that fit into the first-level cache: 16 KB of floats."""
_BLOCK: Final = 128
_SQUARE: Final = 256
_SECONDS: Final = 1e-3
"""Duration of one loop in s, short enough that the scheduler interrupts only a few of many loops."""
_REPEATS: Final = 200


@dataclass(frozen=True, kw_only=True)
class CoreLimits:
    """Measured limits of one core.

    Attributes:
        float_macs_per_s: multiply-accumulates per second in float32.
        integer_macs_per_s: multiply-accumulates per second in integers.
        bytes_per_s: bytes per second read from an array of the networks' size.
    """

    float_macs_per_s: float
    integer_macs_per_s: float
    bytes_per_s: float


@dataclass(frozen=True, kw_only=True)
class Work:
    """The work of a control step.

    Attributes:
        macs: number of multiply-accumulates.
        weights_read: number of weights read from memory; a weight counts each time that it is read.
    """

    macs: int
    weights_read: int

    @classmethod
    def of(cls, program: ControllerProgram) -> "Work":
        """Compute the work of a program's control step."""
        encoder, dynamics, decoder = program.encoder, program.dynamics, program.decoder
        lstm = encoder.lstm.weight_input.size + encoder.lstm.weight_recurrent.size
        head = encoder.hidden.weight.size + encoder.output.weight.size
        rolled = sum(layer.weight.size for layer in (dynamics.input, dynamics.hidden, dynamics.output))
        decoded = decoder.input.weight.size + decoder.output.weight.size
        decoded += sum(block.linear.weight.size for block in decoder.blocks)
        passes, horizon = 2 * program.mpc.iterations + 1, program.mpc.horizon
        return cls(
            macs=program.window * lstm + head + passes * horizon * (rolled + decoded),
            weights_read=program.window * lstm + head + passes * (horizon * rolled + decoded),
        )

    def floor_ms(self, macs_per_s: float, bytes_per_weight: int, bytes_per_s: float) -> float:
        """Return the lower limit of a control step's time in ms."""
        return 1e3 * max(self.macs / macs_per_s, self.weights_read * bytes_per_weight / bytes_per_s)


def measure_core(weights: int, compiler: Sequence[str]) -> CoreLimits:
    """Measure the limits of this core. Raises LibraryError if the compiler rejects the loops.

    Args:
        weights: number of the networks' weights, which is the number of floats in the array that is read.
        compiler: command that compiles C.
    """
    count = max(1, weights // _BLOCK) * _BLOCK
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "floors.so")
        compile_c({"floors.c": _SOURCE}, path, compiler=compiler, flags=("-fPIC", "-shared", *OPTIMISED))
        library = ctypes.CDLL(str(path))
        library.read_all.restype = ctypes.c_float
        floats = (ctypes.c_float * max(count, _IN_FIRST_LEVEL))(*([1e-3] * max(count, _IN_FIRST_LEVEL)))
        integers = (ctypes.c_int16 * _IN_FIRST_LEVEL)(*([3] * _IN_FIRST_LEVEL))
        integer_sums = (ctypes.c_int32 * 8)()
        square = torch.full((_SQUARE, _SQUARE), 1e-3)
        product = torch.empty_like(square)
        small, size = ctypes.c_size_t(_IN_FIRST_LEVEL), ctypes.c_size_t(count)

        def products(times: int) -> None:
            for _ in range(times):
                torch.mm(square, square, out=product)

        def integer_products(times: int) -> None:
            library.integer_products(integers, integers, small, ctypes.c_long(times), integer_sums)

        def reading(times: int) -> None:
            library.read_all(floats, size, ctypes.c_long(times))

        return CoreLimits(
            float_macs_per_s=_SQUARE**3 * _rate(products),
            integer_macs_per_s=_IN_FIRST_LEVEL * _rate(integer_products),
            bytes_per_s=4 * count * _rate(reading),
        )


def _rate(loop: Callable[[int], None]) -> float:
    """Return the number of passes per second of a loop. The best of several measurements is returned, because the rate
    is used as a limit."""
    times = 1
    while (took := _least(loop, times, 3)) < _SECONDS:
        times *= max(2, int(_SECONDS / max(took, 1e-6)))
    return times / _least(loop, times, _REPEATS)


def _least(loop: Callable[[int], None], times: int, repeats: int) -> float:
    return min(_timed(loop, times) for _ in range(repeats))


def _timed(loop: Callable[[int], None], times: int) -> float:
    began = time.perf_counter()
    loop(times)
    return time.perf_counter() - began
