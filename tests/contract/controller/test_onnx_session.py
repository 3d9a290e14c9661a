"""ONNX Runtime as the controller of a bundle: its shapes are the manifest's, and its answers are the graph's."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from contract.config.controller import MpcConfig
from contract.controller.interface import ControllerError, Sizes
from contract.controller.onnx_session import OnnxController
from contract.errors import BundleError
from contract.release import bundle


@pytest.fixture(scope="module")
def release(random_release) -> bundle.Bundle:
    return bundle.load(random_release)


def test_the_controller_is_the_bundles(release):
    controller = OnnxController.of(release)
    controller.warm_up(1)
    manifest = release.manifest
    horizon = manifest.mpc.horizon
    window = np.zeros((manifest.window, 5))
    plan, committed = np.linspace(0.0, 0.07, horizon), np.zeros(horizon)
    held = controller.control_step(window, plan, committed)
    np.testing.assert_allclose(held.plan, np.append(plan[1:], plan[-1]), atol=1e-8)
    free = controller.control_step(window, plan, np.ones(horizon))
    assert (free.plan != held.plan).all()
    assert np.abs(free.plan).max() <= manifest.action_limit
    assert free.cost < held.cost
    assert free.forces.shape == (horizon, 2)


def test_a_model_that_contradicts_its_manifest_is_refused(release):
    def altered(**changes: Any) -> bundle.Bundle:
        """The release with other facts about it."""
        return replace(release, manifest=replace(release.manifest, **changes))

    with pytest.raises(BundleError, match="'window' has shape"):
        OnnxController.of(altered(window=7))
    with pytest.raises(BundleError, match="'plan' has shape"):
        OnnxController.of(altered(mpc=MpcConfig(horizon=9)))
    broken = replace(release, files={"controller.onnx": b"no model"})
    with pytest.raises(BundleError, match=r"controller\.onnx does not load"):
        OnnxController.of(broken)


def test_weights_are_optional_and_their_default_is_the_manifests(release):
    controller, mpc = OnnxController.of(release), release.manifest.mpc
    shapes = Sizes.of(release.manifest).shapes()
    window, plan, free = (np.full(shapes[name], value) for name, value in dict(window=0.1, plan=0.02, free=1.0).items())
    default = controller.control_step(window, plan, free)
    given = controller.control_step(window, plan, free, np.array(mpc.weights.as_tuple()))
    np.testing.assert_array_equal(given.plan, default.plan)
    # J is the weights times the terms, summed in float32.
    assert default.cost == pytest.approx(float(np.array(mpc.weights.as_tuple()) @ default.terms), rel=1e-5)
    assert (controller.control_step(window, plan, free, np.eye(7)[5]).plan != default.plan).any()


def test_inputs_of_another_shape_are_the_controllers_failure(release):
    horizon = release.manifest.mpc.horizon
    with pytest.raises(ControllerError, match=r"controller\.onnx failed"):
        OnnxController.of(release).control_step(np.zeros((2, 2)), np.zeros(horizon), np.ones(horizon))
