"""The sensor estimator in C against ONNX Runtime, which runs the graph that its numbers come from."""

import ctypes
import shutil
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contract.config.tree import Config
from contract.controller.estimator import ESTIMATOR, EstimatorNetwork, Hypotheses
from contract.controller.interface import Sizes
from contract.errors import ExportError
from contract.release.bundle import load
from contract.runtime.onnx_session import OnnxEstimator
from contract.shipped import BUNDLE
from ecu.c.sources import sources_in
from ecu.in_c.c_settings import HEADER, ecu_settings
from ecu.in_c.compiler import host_compiler
from examples.c_samples import MODEL, MPC
from examples.random_programs import random_program
from export.int8 import rounded_estimator
from export.program.controller_program import random_windows
from export.to_c.estimator import estimator_files
from export.to_c.library import int8_library
from export.to_onnx.sensor_estimator import build_estimator
from tests.examples import examples

pytestmark = pytest.mark.compiler

WINDOW = 32
SANITISED = ("-O1", "-ffp-contract=off", "-fsanitize=undefined,float-cast-overflow", "-fno-sanitize-recover=all")
"""What the sanitisers find ends the test's process; with GCC alone."""
SHIM = Path(__file__).with_name("c").joinpath("estimate.c").read_bytes()


def random_network(seed: int = 0, width: int = 64, rows: int = WINDOW) -> EstimatorNetwork:
    """One of the shipped one's shape, whose layers keep the size of what they are given."""
    rng = np.random.default_rng(seed)
    sizes = (rows * 5 + 4, width, width, 4)
    layers = [(rng.normal(size=(b, a)) * np.sqrt(2 / a), rng.normal(size=b) / 4) for a, b in pairwise(sizes)]
    mean, std = np.array([-0.29, -0.36, -0.41, -0.37, 0.0]), np.array([0.18, 0.22, 0.24, 0.27, 0.03])
    return EstimatorNetwork(window=rows, mean=mean, std=std, layers=layers)


NETWORK = random_network()
Estimate = Callable[..., np.ndarray]
"""(S + P, S) of a window, of which some rows have been."""


def graph(of=NETWORK) -> bytes:
    return build_estimator(rounded_estimator(of)).SerializeToString()


@pytest.fixture(scope="module")
def in_c(shared_builds, tmp_path_factory) -> Callable[..., Estimate]:
    """The estimator of a graph, compiled with the headers of a small library and of the shipped release's ECU."""
    program = random_program(0, model=MODEL, mpc=MPC)
    library = int8_library(program, random_windows(program, 10))
    around = sources_in()
    headers = {name: text for name, text in (library | around).items() if name.endswith(".h")}
    headers |= {HEADER: ecu_settings(load(BUNDLE), Config())}
    compiler = ["gcc"] if shutil.which("gcc") else host_compiler()

    def build(content: bytes, flags: tuple[str, ...] = SANITISED) -> Estimate:
        path = tmp_path_factory.mktemp("estimator") / "estimator.so"
        contents = headers | estimator_files(content)
        contents |= {"sw_estimator.c": around["sw_estimator.c"], "shim.c": SHIM}
        used = [flag for flag in flags if compiler == ["gcc"] or "sanitize" not in flag]
        shared_builds.compile_c(contents, path, compiler=compiler, flags=["-shared", "-fPIC", "-g1", *used])
        function = ctypes.CDLL(str(path)).estimate

        def estimate(window: np.ndarray, rows: int = WINDOW) -> np.ndarray:
            given, found = np.ascontiguousarray(window, dtype=np.float64), np.empty((10, 4))
            function(given.ctypes.data_as(ctypes.c_void_p), WINDOW - rows, found.ctypes.data_as(ctypes.c_void_p))
            return found

        return estimate

    return build


@pytest.fixture(scope="module")
def estimate(in_c) -> Estimate:
    return in_c(graph())


@pytest.fixture(scope="module")
def by_onnx() -> Estimate:
    """The same from the graph."""
    runtime = OnnxEstimator(graph(), Sizes(window=WINDOW, sensors=4, horizon=8))
    return lambda window: runtime.estimates(window)[Hypotheses.of(4).view, np.arange(4)]


def window(seed: int, scale: float = 1.0):
    return NETWORK.mean + scale * NETWORK.std * np.random.default_rng(seed).normal(size=(WINDOW, 5))


@given(st.integers(0, 2**32), st.floats(0.0, 3.0))
@examples(100)
def test_it_estimates_what_onnx_runtime_does(estimate, by_onnx, seed, scale):
    seen = window(seed, scale)
    apart = (estimate(seen) - by_onnx(seen)) / NETWORK.std[:4]
    # In deviations of a pressure. Readings are in steps of 1 / 2047: over 160 of them, each wrong by 0.29 steps, 0.0018
    # into layers that keep the size of what they are given, of which a ReLU takes half each time. A sound sensor's
    # residual is 0.2, a hundred times that.
    assert np.sqrt(np.mean(np.square(apart))) < 1e-3
    assert np.abs(apart).max() < 3e-3


@given(st.integers(0, 2**32), st.integers(0, 3), st.floats(-1e30, 1e30))
@examples(100)
def test_whatever_a_broken_sensor_reads_the_estimates_are_those_of_the_graph(estimate, by_onnx, seed, sensor, reading):
    seen = window(seed)
    seen[:, sensor] = reading
    # Activations are up to the reach of 16 deviations, and so are their steps: 1 / 32767 of the largest.
    np.testing.assert_allclose(estimate(seen) / NETWORK.std[:4], by_onnx(seen) / NETWORK.std[:4], atol=1e-2)


@given(st.integers(0, 2**32), st.integers(1, WINDOW))
@examples(50)
def test_before_the_first_row_the_window_is_like_it(estimate, seed, rows):
    seen = window(seed)
    filled = seen.copy()
    filled[: WINDOW - rows] = filled[WINDOW - rows]
    np.testing.assert_array_equal(estimate(seen, rows), estimate(filled))


def test_it_computes_the_same_bits_with_vector_instructions(estimate, in_c):
    other = in_c(graph(), ("-O3", "-march=native", "-ffp-contract=off"))
    for seed in range(20):
        np.testing.assert_array_equal(other(window(seed)), estimate(window(seed)))


def test_where_all_hidden_activations_are_0_the_estimate_is_the_biases(in_c):
    """There is no largest activation to scale by."""
    silent = [(weight, np.full_like(bias, -1e3)) for weight, bias in NETWORK.layers[:2]] + [*NETWORK.layers[2:]]
    expected = NETWORK.mean[:4] + NETWORK.std[:4] * NETWORK.layers[2][1]
    # The answer is a number of order one in single precision.
    found = in_c(graph(replace(NETWORK, layers=silent)))(window(0))
    np.testing.assert_allclose(found, np.tile(expected, (10, 1)), rtol=1e-6)
    # Networks that the sources cannot run are refused.
    first, second, last = NETWORK.layers
    narrower = (second[0][:40], second[1][:40])
    unequal = [[first, narrower, (last[0][:, :40], last[1])], [first, last]]
    for other, message in (
        *((replace(NETWORK, layers=layers), "must have two hidden layers of equal width") for layers in unequal),
        (random_network(width=63), f"{ESTIMATOR}: its hidden layers are 63 long: the C library accepts"),
        (random_network(width=520), "a layer has 520 inputs; the C library accepts at most"),
    ):
        with pytest.raises(ExportError, match=message):
            estimator_files(graph(other))
