"""`sensors.onnx` as ONNX Runtime computes it, against the same network in NumPy."""

import numpy as np
import onnx
import pytest

from contract.controller.estimator import views
from contract.controller.interface import ControllerError, Sizes
from contract.controller.onnx_estimator import OnnxEstimator
from contract.errors import BundleControllerError, ExportError
from contract.release.onnx_graph import check_estimator_graph, check_graph
from export.to_onnx.sensor_estimator import build_estimator
from tests.contract.controller.test_estimator import random_network

SIZES = Sizes(window=5, sensors=4, horizon=3)


def test_onnx_runtime_and_numpy_estimate_the_same() -> None:
    network = random_network()
    estimator = OnnxEstimator(build_estimator(network).SerializeToString(), SIZES)
    for seed in range(20):
        window = np.random.default_rng(seed).normal(size=(5, 5))
        # float32 beside float64: sums of some tens of terms of order one.
        np.testing.assert_allclose(estimator.estimates(window), network.estimates(window), atol=5e-6)


def test_the_graph_holds_what_a_bundle_may_hold_and_is_no_controller() -> None:
    content = build_estimator(random_network()).SerializeToString()
    assert check_estimator_graph(content, SIZES) == len(onnx.load_from_string(content).graph.node)
    with pytest.raises(ValueError, match="'plan' is missing"):
        check_graph(content, SIZES)


def test_a_graph_of_other_sizes_is_refused() -> None:
    content = build_estimator(random_network()).SerializeToString()
    for sizes in (Sizes(window=6, sensors=4, horizon=3), Sizes(window=5, sensors=3, horizon=3)):
        with pytest.raises(ValueError, match=r"'window' has shape \(5, 5\)"):
            check_estimator_graph(content, sizes)
        with pytest.raises(BundleControllerError, match=r"sensors\.onnx: 'window' has shape \[5, 5\]"):
            OnnxEstimator(content, sizes)


def test_a_graph_with_a_default_window_is_refused() -> None:
    model = build_estimator(random_network())
    model.graph.initializer.append(onnx.numpy_helper.from_array(np.zeros((5, 5), dtype=np.float32), "window"))
    with pytest.raises(ValueError, match="input 'window' has a default: none may"):
        check_estimator_graph(model.SerializeToString(), SIZES)


def test_estimates_that_are_not_finite_are_no_estimates() -> None:
    estimator = OnnxEstimator(build_estimator(random_network()).SerializeToString(), SIZES)
    with pytest.raises(ControllerError, match="not finite"):
        estimator.estimates(np.full((5, 5), np.nan))


def test_numbers_without_a_float32_are_refused() -> None:
    network = random_network()
    network.mean[0] = 1e300
    with pytest.raises(ExportError, match="mean"):
        build_estimator(network)


def test_there_is_a_row_for_every_view() -> None:
    model = build_estimator(random_network())
    (output,) = model.graph.output
    assert [side.dim_value for side in output.type.tensor_type.shape.dim] == [len(views(4)), 4]
