"""The sensor estimator in C against ONNX Runtime, which runs the graph that its numbers come from."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contract.controller.estimator import ESTIMATOR
from contract.controller.interface import Sizes
from contract.errors import ExportError
from contract.runtime.onnx_estimator import OnnxEstimator
from export.int8.rounded_estimator import rounded_estimator
from export.to_c.estimator import estimator_files
from export.to_onnx.sensor_estimator import build_estimator
from tests.examples import examples
from tests.export.to_c.ecu.sensor_parts import WINDOW, SensorParts, built, by_hypothesis, network

pytestmark = pytest.mark.compiler

NETWORK = network()
FILES = ("sw_estimator.c",)


def graph(of=NETWORK) -> bytes:
    content: bytes = build_estimator(rounded_estimator(of)).SerializeToString()
    return content


@pytest.fixture(scope="module")
def estimator(tmp_path_factory, shared_builds) -> SensorParts:
    return built(estimator_files(graph()), FILES, tmp_path_factory.mktemp("estimator"), shared_builds.compile_c)


@pytest.fixture(scope="module")
def onnx_estimator() -> OnnxEstimator:
    return OnnxEstimator(graph(), Sizes(window=WINDOW, sensors=4, horizon=8))


def window(seed: int, scale: float = 1.0):
    rng = np.random.default_rng(seed)
    return NETWORK.mean + scale * NETWORK.std * rng.normal(size=(WINDOW, 5))


@given(st.integers(0, 2**32), st.floats(0.0, 3.0))
@examples(200)
def test_it_estimates_what_onnx_runtime_does(estimator, onnx_estimator, seed, scale):
    seen = window(seed, scale)
    apart = (estimator.estimates(seen) - by_hypothesis(onnx_estimator.estimates(seen))) / NETWORK.std[:4]
    # In deviations of a pressure. Readings are in steps of 1 / 2047: over 160 of them, each wrong by 0.29 steps, 0.0018
    # into layers that keep the size of what they are given, of which a ReLU takes half each time. A sound sensor's
    # residual is 0.2, a hundred times that.
    assert np.sqrt(np.mean(np.square(apart))) < 1e-3
    assert np.abs(apart).max() < 3e-3


@given(st.integers(0, 2**32), st.integers(0, 3), st.floats(-1e30, 1e30))
@examples(100)
def test_whatever_a_broken_sensor_reads_the_estimates_are_those_of_the_graph(
    estimator, onnx_estimator, seed, sensor, reading
):
    seen = window(seed)
    seen[:, sensor] = reading
    found = estimator.estimates(seen)
    expected = by_hypothesis(onnx_estimator.estimates(seen))
    # Activations are up to the reach of 16 deviations, and so are their steps: 1 / 32767 of the largest.
    np.testing.assert_allclose(found / NETWORK.std[:4], expected / NETWORK.std[:4], atol=1e-2)


@given(st.integers(0, 2**32), st.integers(1, WINDOW))
@examples(50)
def test_before_the_first_row_the_window_is_like_it(estimator, seed, rows):
    seen = window(seed)
    filled = seen.copy()
    filled[: WINDOW - rows] = filled[WINDOW - rows]
    np.testing.assert_array_equal(estimator.estimates(seen, rows), estimator.estimates(filled))


def test_it_computes_the_same_bits_with_vector_instructions(estimator, tmp_path, shared_builds):
    flags = ("-O3", "-march=native", "-ffp-contract=off")
    other = built(estimator_files(graph()), FILES, tmp_path, shared_builds.compile_c, flags)
    for seed in range(20):
        np.testing.assert_array_equal(other.estimates(window(seed)), estimator.estimates(window(seed)))


def test_a_view_without_anything_to_say_has_the_biases_estimate(tmp_path, shared_builds, onnx_estimator):
    """All hidden activations are 0: there is no largest one to scale by."""
    silent = replace(
        NETWORK,
        layers=[(weight, np.full_like(bias, -1e3)) for weight, bias in NETWORK.layers[:2]] + [*NETWORK.layers[2:]],
    )
    parts = built(estimator_files(graph(silent)), FILES, tmp_path, shared_builds.compile_c)
    expected = NETWORK.mean[:4] + NETWORK.std[:4] * NETWORK.layers[2][1]
    # The answer is a number of order one in single precision.
    np.testing.assert_allclose(parts.estimates(window(0)), np.tile(expected, (10, 1)), rtol=1e-6)


def test_networks_that_the_sources_cannot_run_are_refused():
    first, second, last = NETWORK.layers
    narrower = (second[0][:40], second[1][:40])
    for layers, said in (
        ([first, narrower, (last[0][:, :40], last[1])], "takes two hidden ones of equal width"),
        ([first, last], "takes two hidden ones of equal width"),
    ):
        with pytest.raises(ExportError, match=said):
            estimator_files(graph(replace(NETWORK, layers=layers)))
    with pytest.raises(ExportError, match=f"{ESTIMATOR}: its hidden layers are 63 long: the C library takes"):
        estimator_files(graph(network(width=63)))
    with pytest.raises(ExportError, match="520 inputs of a layer: the C library takes"):
        estimator_files(graph(network(width=520)))
