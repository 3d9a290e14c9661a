"""C's own functions against NumPy's: float32 within the bounds that `sw_math.h` states, and the tables of int8."""

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
from export.to_c import int8_arrays
from export.to_c.int8_arrays import ELU_ARGUMENT_ONE, ELU_ONE, ELU_RANGE, LOGISTIC_ONE, LOGISTIC_QMAX, LOGISTIC_RANGE
from export.to_c.library import c_library, static_sources

SHIMS = Path(__file__).with_name("c")
EXP, LOGISTIC, TANH, INVERSE_SQRT, SQRT = range(5)
ELU_TABLE, LOGISTIC_TABLE, TANH_TABLE = range(3)


def applied(library: ctypes.CDLL, dtype: type[np.generic]):
    """A shim's functions, by their numbers, over arrays of this type."""

    def apply(which, x):
        x = np.ascontiguousarray(x, dtype=dtype)
        y = np.empty_like(x)
        library.apply(which, len(x), ctypes.c_void_p(x.ctypes.data), ctypes.c_void_p(y.ctypes.data))
        return y.astype(np.float64)

    return apply


@pytest.fixture(scope="module")
def apply(tmp_path_factory, shared_builds):
    """One of the functions over an array of float32, compiled with every optimisation."""
    path = tmp_path_factory.mktemp("math") / "math.so"
    contents = {name: static_sources("float32")[name] for name in ("sw_math.h", "sw_compiler.h")}
    contents["shim.c"] = SHIMS.joinpath("math.c").read_bytes()
    shared_builds.compile_c(contents, path, compiler=host_compiler(), flags=("-shared", "-fPIC", "-O3"))
    return applied(ctypes.CDLL(str(path)), np.float32)


def spread(low: float, high: float) -> np.ndarray:
    """A million float32 between the two."""
    return np.linspace(low, high, 1_000_000).astype(np.float32)


def test_exp(apply):
    x = spread(-87.0, 88.0)
    np.testing.assert_allclose(apply(EXP, x), np.exp(x.astype(np.float64)), rtol=1.5e-7, atol=0)
    near = spread(-0.4, 0.4)
    np.testing.assert_allclose(apply(EXP, near), np.exp(near.astype(np.float64)), rtol=1.5e-7, atol=0)
    # Exp of zero is one and beyond its range it stays.
    np.testing.assert_array_equal(apply(EXP, [0.0]), [1.0])
    far = apply(EXP, [-1e30, -np.inf, -100.0, 100.0, 1e30, np.inf])
    np.testing.assert_array_equal(far[:3], apply(EXP, [-87.0] * 3))
    np.testing.assert_array_equal(far[3:], apply(EXP, [88.0] * 3))
    assert np.isfinite(far).all() and far[0] < 2e-38


def test_logistic_and_tanh(apply):
    x = np.concatenate([spread(-30.0, 30.0), [-1e9, 1e9, 0.0]]).astype(np.float32)
    exact = x.astype(np.float64)
    half = 0.5 * exact
    np.testing.assert_allclose(apply(LOGISTIC, x), 0.5 * (1 + np.tanh(half)), rtol=0, atol=1.5e-7)
    np.testing.assert_allclose(apply(TANH, x), np.tanh(exact), rtol=0, atol=3e-7)


def test_roots(apply):
    x = np.exp(spread(np.log(1.2e-38), np.log(1e38)).astype(np.float64)).astype(np.float32)
    exact = np.sqrt(x.astype(np.float64))
    np.testing.assert_allclose(apply(INVERSE_SQRT, x), 1 / exact, rtol=3e-7, atol=0)
    np.testing.assert_allclose(apply(SQRT, x), exact, rtol=3e-7, atol=0)
    # Below the normal numbers the root is taken as 0, which is off by less than 1.1e-19.
    np.testing.assert_array_equal(apply(SQRT, [0.0, 1e-45, 1e-39]), 0.0)


@pytest.fixture(scope="module")
def library(tmp_path_factory, shared_builds):
    """The functions of `sw_tables.h` with the tables that the exporter writes."""
    model = ModelConfig(window=2, latent=2, lstm_width=3, dynamics_width=3, decoder_width=3)
    rounded = rounded_to_nearest(random_program(5, model=model, mpc=MpcConfig(horizon=4)))
    path = tmp_path_factory.mktemp("tables") / "tables.so"
    contents = library_sources(c_library(rounded, random_windows(rounded.program, 1)))
    contents["shim.c"] = SHIMS.joinpath("tables.c").read_bytes()
    shared_builds.compile_c(contents, path, compiler=host_compiler(), flags=("-shared", "-fPIC", "-O1"))
    return ctypes.CDLL(str(path))


def every_integer(reach: int, one: int) -> tuple[np.ndarray, np.ndarray]:
    """Every argument of a table, as the C function takes it and as the number that it stands for."""
    integers = np.arange(2 * reach * one)
    return integers, integers / one - reach


@pytest.mark.slow
def test_tables_are_as_near_as_stated(library):
    """Half an integer for the point, half for the straight line (h^2 / 8 max |f''|), half for the sum: at worst 1.5."""
    apply = applied(library, np.int32)
    integers, x = every_integer(ELU_RANGE, ELU_ARGUMENT_ONE)
    exact = ELU_ONE * np.where(x < 0, np.expm1(np.minimum(x, 0)), x)
    assert np.abs(apply(ELU_TABLE, integers) - exact).max() < 1.5
    # Twice half an integer of 1 / 32767 for rounding, and h^2 / 8 max |f''| = 1.2e-5 for the straight line.
    integers, x = every_integer(LOGISTIC_RANGE, LOGISTIC_ONE)
    np.testing.assert_allclose(apply(LOGISTIC_TABLE, integers) / LOGISTIC_QMAX, expit(x), rtol=0, atol=5e-5)
    # tanh(x) = 2 logistic(2 x) - 1; the argument is 2 x.
    integers, twice = every_integer(LOGISTIC_RANGE, LOGISTIC_ONE)
    np.testing.assert_allclose(apply(TANH_TABLE, integers) / LOGISTIC_QMAX, np.tanh(twice / 2), rtol=0, atol=1e-4)
    # Beyond a table its ends stay.
    for which, reach, one in ((ELU_TABLE, ELU_RANGE, ELU_ARGUMENT_ONE), (LOGISTIC_TABLE, LOGISTIC_RANGE, LOGISTIC_ONE)):
        last = 2 * reach * one - 1
        beyond = apply(which, [-(2**31), -1, last + 1, 2**31 - 1])
        np.testing.assert_array_equal(beyond, apply(which, [0, 0, last, last]))


def test_no_sum_of_products_can_overflow_32_bits(library):
    for width in range(4, 2065, 4):
        assert width % 8 or library.qmax(width) == int8_arrays.qmax(width)
        assert 127 * int8_arrays.qmax(width) * width <= 2**31 - 1
    with pytest.raises(ExportError, match="at most 2064"):
        int8_arrays.qmax(2068)
