"""The C library's own functions against NumPy's, within the bounds that `sw_math.h` states."""

import ctypes
from pathlib import Path

import numpy as np
import pytest

from ecu.in_c.compiler import host_compiler
from export.to_c.library import static_sources

SHIM = Path(__file__).with_name("c").joinpath("math.c").read_bytes()
EXP, LOGISTIC, TANH, INVERSE_SQRT, SQRT = range(5)


@pytest.fixture(scope="module")
def apply(tmp_path_factory, shared_builds, applied):
    """One of the functions over an array of float32, compiled with every optimisation."""
    path = tmp_path_factory.mktemp("math") / "math.so"
    contents = {name: static_sources("float32")[name] for name in ("sw_math.h", "sw_compiler.h")} | {"shim.c": SHIM}
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
