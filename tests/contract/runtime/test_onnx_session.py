"""ONNX Runtime as the controller of a bundle: its shapes are the manifest's, and its answers are the graph's."""

import copy
import pickle
import resource
from dataclasses import replace

import numpy as np
import onnx
import onnxruntime
import pytest

from contract.controller.interface import ControllerError
from contract.errors import BundleControllerError, BundleError
from contract.release import bundle
from contract.release.checks import Bundle
from contract.runtime.onnx_session import OnnxController
from tests.contract.controller import graphs


@pytest.fixture(scope="module")
def release(random_release) -> Bundle:
    return bundle.load(random_release)


def test_the_controller_is_the_bundles_and_a_copy_computes_the_same_in_a_session_of_its_own(release):
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
    for one in (copy.copy(controller), pickle.loads(pickle.dumps(controller))):
        assert one._session is not controller._session
        assert one.description == controller.description
        np.testing.assert_array_equal(one.control_step(window, plan, np.ones(horizon)).plan, free.plan)


def test_a_model_that_contradicts_its_manifest_is_refused(release):
    with pytest.raises(BundleError, match="'window' has shape"):
        OnnxController.of(replace(release, manifest=replace(release.manifest, window=7)))
    broken = replace(release, files={"controller.onnx": b"no model"})
    with pytest.raises(BundleError, match=r"controller\.onnx does not load"):
        OnnxController.of(broken)
    horizon = release.manifest.mpc.horizon
    with pytest.raises(ControllerError, match=r"controller\.onnx failed"):
        OnnxController.of(release).control_step(np.zeros((2, 2)), np.zeros(horizon), np.ones(horizon))


def test_weights_are_optional_and_their_default_is_the_manifests(release):
    controller, mpc = OnnxController.of(release), release.manifest.mpc
    shapes = release.manifest.sizes.shapes()
    window, plan, free = (np.full(shapes[name], value) for name, value in dict(window=0.1, plan=0.02, free=1.0).items())
    default = controller.control_step(window, plan, free)
    given = controller.control_step(window, plan, free, np.array(mpc.weights.as_tuple()))
    np.testing.assert_array_equal(given.plan, default.plan)
    # J is the weights times the terms, summed in float32.
    assert default.cost == pytest.approx(float(np.array(mpc.weights.as_tuple()) @ default.terms), rel=1e-5)
    assert (controller.control_step(window, plan, free, np.eye(8)[5]).plan != default.plan).any()


def test_an_input_of_another_name_or_a_speed_of_another_shape_is_refused(release):
    for name, message in (("tempo", r"failed on a window of zeros: .*'tempo'"), ("speed", r"'speed' has shape \[2\]")):
        model = graphs.graph_of()
        model.graph.input.append(graphs.value(name, (2,)))
        with pytest.raises(BundleControllerError, match=message):
            OnnxController.of(unchecked(release, model.SerializeToString()))


def test_a_graph_without_end_is_stopped():
    controller = OnnxController(graphs.endless(), graphs.SIZES)
    with pytest.raises(BundleControllerError, match=r"0 of 3 steps on zeros were done after 0\.\d s: all .* in 0\.3 s"):
        controller.warm_up(3, limit_s=0.3)
    OnnxController(graphs.graph_of().SerializeToString(), graphs.SIZES).warm_up(3, limit_s=5.0)


def unchecked(release: Bundle, model: bytes) -> Bundle:
    """The release around another graph, which nobody judged."""
    sizes = graphs.SIZES
    mpc = replace(release.manifest.mpc, horizon=sizes.horizon)
    scaling = replace(release.manifest.scaling, pressure_mean=(0.0,), pressure_std=(1.0,))
    manifest = replace(
        release.manifest, window=sizes.window, sensors=("base_0",), sensor_positions=None, mpc=mpc, scaling=scaling
    )
    return replace(release, manifest=manifest, files={"controller.onnx": model})


def test_constants_that_multiply_to_gigabytes_are_not_computed(release):
    """The product would be computed while the graph loads, had no step shown before what it takes."""
    resident = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(BundleControllerError, match=r"controller\.onnx failed on a window of zeros"):
        OnnxController.of(unchecked(release, graphs.enormous()))
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - resident < 400_000


def test_a_step_whose_memory_depends_on_its_data_fails_and_takes_none():
    """On zeros it is tame, so that no warm-up finds it."""
    controller = OnnxController(graphs.greedy(), graphs.SIZES)
    controller.warm_up(1)
    resident = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    window, plan, free = (np.ones(graphs.SHAPES[name]) for name in ("window", "plan", "free"))
    with pytest.raises(ControllerError, match=r"controller\.onnx failed"):
        controller.control_step(window, plan, free)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - resident < 400_000


def test_answers_that_are_not_finite_are_named(release):
    """3e38 is a float32; its square is not."""
    for bad in (np.nan, 3e38):
        square = onnx.helper.make_node("Mul", ["bad", "bad"], ["worse"])
        added = onnx.helper.make_node("Add", ["plan", "worse"], ["p"])
        model = graphs.graph_of([square, added], [graphs.constant("bad", bad)], "p")
        with pytest.raises(BundleControllerError, match="'new_plan' is not finite for a window of zeros"):
            OnnxController.of(unchecked(release, model.SerializeToString()))


def test_a_constant_in_the_working_directory_is_not_read(tmp_path, monkeypatch):
    """Were it read, whoever can write there could change the answers of a release that is signed."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "weights.bin").write_bytes(np.ones(64, dtype=np.float32).tobytes())
    product = onnx.helper.make_node("MatMul", ["outside", "plan"], ["p"])
    content = graphs.graph_of([product], [graphs.outside()], "p").SerializeToString()
    onnxruntime.InferenceSession(content, providers=["CPUExecutionProvider"])  # By itself it reads the file.
    with pytest.raises(BundleControllerError, match=r"controller\.onnx does not load"):
        OnnxController(content, graphs.SIZES)
