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
    controller, manifest = OnnxController.of(release), release.manifest
    controller.warm_up(1)
    horizon, default = manifest.mpc.horizon, np.array(manifest.mpc.weights.as_tuple())
    window = np.zeros((manifest.window, 5))
    plan, committed = np.linspace(0.0, 0.07, horizon), np.zeros(horizon)
    held = controller.control_step(window, plan, committed)
    np.testing.assert_allclose(held.plan, np.append(plan[1:], plan[-1]), atol=1e-8)
    free = controller.control_step(window, plan, np.ones(horizon))
    assert (free.plan != held.plan).all()
    assert np.abs(free.plan).max() <= manifest.action_limit
    assert free.cost < held.cost
    assert free.forces.shape == (horizon, 2)
    # Weights are optional, and their default is the manifest's. J is the weights times the terms, summed in float32.
    given = controller.control_step(window, plan, np.ones(horizon), default)
    np.testing.assert_array_equal(given.plan, free.plan)
    assert free.cost == pytest.approx(float(default @ free.terms), rel=1e-5)
    assert (controller.control_step(window, plan, np.ones(horizon), np.eye(8)[5]).plan != free.plan).any()
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


def test_a_graph_without_end_is_stopped():
    controller = OnnxController(graphs.endless(), graphs.SIZES)
    with pytest.raises(BundleControllerError, match=r"0 of 3 steps on zeros were done after 0\.\d s: all .* in 0\.3 s"):
        controller.warm_up(3, limit_s=0.3)
    OnnxController(graphs.graph_of().SerializeToString(), graphs.SIZES).warm_up(3, limit_s=5.0)


def with_input(name: str) -> bytes:
    model = graphs.graph_of()
    model.graph.input.append(graphs.value(name, (2,)))
    return model.SerializeToString()


def with_square_of(number: float) -> bytes:
    square = onnx.helper.make_node("Mul", ["bad", "bad"], ["worse"])
    added = onnx.helper.make_node("Add", ["plan", "worse"], ["p"])
    return graphs.graph_of([square, added], [graphs.constant("bad", number)], "p").SerializeToString()


def test_a_graph_whose_first_step_fails_is_refused_and_takes_no_memory(release):
    """A product of gigabytes would be computed while the graph loads, had no step shown before what it takes."""
    sizes, shipped = graphs.SIZES, release.manifest
    mpc = replace(shipped.mpc, horizon=sizes.horizon)
    scaling = replace(shipped.scaling, pressure_mean=(0.0,), pressure_std=(1.0,))
    one = {"sensors": ("base_0",), "sensor_positions": None}
    manifest = replace(shipped, window=sizes.window, mpc=mpc, scaling=scaling, **one)
    resident = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for model, message in (
        (with_input("tempo"), r"failed on a window of zeros: .*'tempo'"),
        (with_input("speed"), r"'speed' has shape \[2\]"),
        (graphs.enormous(), r"controller\.onnx failed on a window of zeros"),
        (with_square_of(np.nan), "'new_plan' is not finite for a window of zeros"),
        (with_square_of(3e38), "'new_plan' is not finite for a window of zeros"),  # its square is no float32
    ):
        with pytest.raises(BundleControllerError, match=message):
            OnnxController.of(replace(release, manifest=manifest, files={"controller.onnx": model}))
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


def test_a_constant_in_the_working_directory_is_not_read(tmp_path, monkeypatch):
    """Were it read, whoever can write there could change the answers of a release that is signed."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "weights.bin").write_bytes(np.ones(64, dtype=np.float32).tobytes())
    product = onnx.helper.make_node("MatMul", ["outside", "plan"], ["p"])
    content = graphs.graph_of([product], [graphs.outside()], "p").SerializeToString()
    onnxruntime.InferenceSession(content, providers=["CPUExecutionProvider"])  # By itself it reads the file.
    with pytest.raises(BundleControllerError, match=r"controller\.onnx does not load"):
        OnnxController(content, graphs.SIZES)
