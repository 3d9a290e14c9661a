"""`sensors.onnx` as ONNX Runtime computes it, against the same network in NumPy."""

from dataclasses import replace

import numpy as np
import onnx
import pytest

from contract.controller.estimator import REACH, EstimatorNetwork, views
from contract.controller.interface import ControllerError, Sizes
from contract.errors import ExportError
from contract.runtime.onnx_session import OnnxEstimator
from export.int8 import rounded_estimator
from export.release.judged import check_model
from export.to_onnx.sensor_estimator import build_estimator, read_estimator
from tests.contract.controller.test_estimator import random_network


def built(network: EstimatorNetwork | None = None) -> onnx.ModelProto:
    return build_estimator(rounded_estimator(random_network() if network is None else network))


def test_onnx_runtime_and_numpy_estimate_the_same():
    rounded = rounded_estimator(random_network())
    content, network = build_estimator(rounded).SerializeToString(), rounded.network
    assert check_model(content) == len(onnx.load_from_string(content).graph.node)
    estimator = OnnxEstimator(content, Sizes(window=5, sensors=4, horizon=3))
    window = np.random.default_rng(0).normal(size=(5, 5))
    at_the_end, beyond = window.copy(), window.copy()
    # One sensor alone: exchanged ones are judged by the others' ranges.
    at_the_end[:, 2], beyond[:, 2] = network.mean[2] + REACH * network.std[2], 1e6
    own = slice(0, len(views(4)) - 24)
    np.testing.assert_allclose(estimator.estimates(beyond)[own], network.estimates(at_the_end)[own], atol=5e-6)
    windows = np.random.default_rng(0).normal(size=(20, 5, 5))
    for window, expected in zip(windows, network.estimates(windows), strict=True):
        # float32 against float64: sums of some tens of terms of order one.
        np.testing.assert_allclose(estimator.estimates(window), expected, atol=5e-6)
    with pytest.raises(ControllerError, match="not finite"):
        estimator.estimates(np.full((5, 5), np.nan))
    network.mean[0] = 1e300
    with pytest.raises(ExportError, match="mean"):
        built(network)


def test_what_is_written_is_read_again_and_another_make_is_not():
    rounded = rounded_estimator(random_network())
    found = read_estimator(build_estimator(rounded).SerializeToString())
    assert found.network.window == 5
    for mine, its in zip(rounded.matrices, found.matrices, strict=True):
        np.testing.assert_array_equal(mine.values, its.values)
        np.testing.assert_array_equal(mine.scales, its.scales)
    window = np.random.default_rng(0).normal(size=(5, 5))
    # The graph has mean, deviation and biases in float32.
    np.testing.assert_allclose(found.network.estimates(window), rounded.network.estimates(window), atol=1e-6)
    # Equal numbers of two layers are read for each.
    network = random_network(width=4)
    (first, _), (second, _), (last, _) = network.layers
    alike = replace(network, layers=[(first, np.zeros(4)), (second, np.zeros(4)), (last, np.zeros(4))])
    same = read_estimator(built(alike).SerializeToString()).network
    assert [bias.tolist() for _, bias in same.layers] == [[0.0] * 4] * 3
    # A graph of another make is not read.
    model = built()
    for node in model.graph.node:
        if node.op_type == "DequantizeLinear":
            node.op_type = "Cast"
    with pytest.raises(ExportError, match=r"sensors\.onnx: has no int8 weights; fit a new estimator"):
        read_estimator(model.SerializeToString())
