"""The integers of the int8 library: their range, and C's own functions on the tables."""

import ctypes
from pathlib import Path

import numpy as np
import pytest
from scipy.special import expit

from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig
from contract.controller.c_folder import library_sources
from contract.errors import ExportError
from ecu.in_c.compiler import host_compiler
from examples.random_programs import random_program
from export.int8 import rounded_to_nearest
from export.program.controller_program import random_windows
from export.to_c.int8_arrays import (
    ELU_ARGUMENT_ONE,
    ELU_ONE,
    ELU_RANGE,
    LOGISTIC_ONE,
    LOGISTIC_QMAX,
    LOGISTIC_RANGE,
    qmax,
)
from export.to_c.library import c_library

SHIM = Path(__file__).with_name("c").joinpath("tables.c").read_bytes()
ELU, LOGISTIC, TANH = range(3)


@pytest.fixture(scope="module")
def library(tmp_path_factory, shared_builds):
    """The functions of `sw_tables.h` with the tables that the exporter writes."""
    model = ModelConfig(window=2, latent=2, lstm_width=3, dynamics_width=3, decoder_width=3)
    rounded = rounded_to_nearest(random_program(5, model=model, mpc=MpcConfig(horizon=4)))
    path = tmp_path_factory.mktemp("tables") / "tables.so"
    contents = library_sources(c_library(rounded, random_windows(rounded.program, 1))) | {"shim.c": SHIM}
    shared_builds.compile_c(contents, path, compiler=host_compiler(), flags=("-shared", "-fPIC", "-O1"))
    return ctypes.CDLL(str(path))


@pytest.fixture(scope="module")
def apply(library, applied):
    return applied(library, np.int32)


def every_integer(reach: int, one: int) -> tuple[np.ndarray, np.ndarray]:
    """Every argument of a table, as the C function takes it and as the number that it stands for."""
    integers = np.arange(2 * reach * one)
    return integers, integers / one - reach


@pytest.mark.slow
def test_tables_are_as_near_as_stated(apply):
    """Half an integer for the point, half for the straight line (h^2 / 8 max |f''|), half for the sum: at worst 1.5."""
    integers, x = every_integer(ELU_RANGE, ELU_ARGUMENT_ONE)
    exact = ELU_ONE * np.where(x < 0, np.expm1(np.minimum(x, 0)), x)
    assert np.abs(apply(ELU, integers) - exact).max() < 1.5
    # Twice half an integer of 1 / 32767 for rounding, and h^2 / 8 max |f''| = 1.2e-5 for the straight line.
    integers, x = every_integer(LOGISTIC_RANGE, LOGISTIC_ONE)
    np.testing.assert_allclose(apply(LOGISTIC, integers) / LOGISTIC_QMAX, expit(x), rtol=0, atol=5e-5)
    # tanh(x) = 2 logistic(2 x) - 1; the argument is 2 x.
    integers, twice = every_integer(LOGISTIC_RANGE, LOGISTIC_ONE)
    np.testing.assert_allclose(apply(TANH, integers) / LOGISTIC_QMAX, np.tanh(twice / 2), rtol=0, atol=1e-4)
    # Beyond a table its ends stay.
    for which, reach, one in ((ELU, ELU_RANGE, ELU_ARGUMENT_ONE), (LOGISTIC, LOGISTIC_RANGE, LOGISTIC_ONE)):
        last = 2 * reach * one - 1
        beyond = apply(which, [-(2**31), -1, last + 1, 2**31 - 1])
        np.testing.assert_array_equal(beyond, apply(which, [0, 0, last, last]))


def test_no_sum_of_products_can_overflow_32_bits(library):
    for width in range(4, 2065, 4):
        assert width % 8 or library.qmax(width) == qmax(width)
        assert 127 * qmax(width) * width <= 2**31 - 1
    with pytest.raises(ExportError, match="at most 2064"):
        qmax(2068)
