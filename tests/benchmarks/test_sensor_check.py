"""What the measurement of the sensor check computes ahead is what the ECU would be given."""

import numpy as np
import pytest

from benchmarks.ecu.sensor_check import Lab, Passage, _windows
from contract.config.tree import Config
from contract.controller.estimator import ESTIMATOR
from contract.errors import StillwakeError
from contract.release import bundle
from contract.shipped import BUNDLE
from export.to_onnx.sensor_estimator import read_estimator
from firmware_sim.ecu.sensor_check import sensor_check_of


def passage(steps: int = 120) -> Passage:
    rng = np.random.default_rng(0)
    return Passage(
        role="test",
        cp=rng.normal(-0.4, 0.2, (steps, 4)),
        actions=rng.normal(0.0, 0.05, steps),
        heard=rng.random(steps) < 0.7,
    )


def test_a_window_has_the_latest_row_last_and_the_pressures_before_where_a_frame_was_lost() -> None:
    read = passage()
    windows = _windows(read, 32)
    for step in (40, 77):
        for back in range(32):
            k = step - back
            last = max(j for j in range(k + 1) if read.heard[j])
            np.testing.assert_array_equal(windows[step, 31 - back], [*read.cp[last], read.actions[k]])


def test_the_network_that_is_read_from_the_graph_computes_what_onnx_runtime_does() -> None:
    release = bundle.load(BUNDLE)
    check = sensor_check_of(release, Config())
    assert check is not None
    network = read_estimator(release.files[ESTIMATOR]).network
    Lab(check=check, network=network).agrees(passage())
    network.layers[0][1][:] += 1.0
    with pytest.raises(StillwakeError, match="NumPy and ONNX Runtime"):
        Lab(check=check, network=network).agrees(passage())
