"""A release that computes nonsense is not confirmed; one that does not load here is not even activated."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from can_bridge.flashing.verdicts import Verdict
from contract.config.tree import Config
from contract.controller.estimator import ESTIMATOR
from contract.controller.interface import Controller, ControllerError
from contract.release.checks import CONTROLLER, Bundle
from contract.runtime.onnx_session import OnnxController
from ecu.flashable.vehicle_fit import VehicleFit, self_test
from tests.ecu.conftest import Answering, RecordingController, answer_of
from tests.ecu.flashable.vehicle_ecu import CONFIRM_ROUTINE, REVERT, SELF_TEST, Rig, image, provision, shipped

LIMIT, HORIZON = shipped().manifest.action_limit, shipped().manifest.mpc.horizon
FAILING = Answering(ControllerError("no answer"))


def planning(value: float, length: int = HORIZON, **changes: Any) -> Answering:
    return Answering(answer_of(HORIZON, plan=np.full(length, value), **changes))


def test_only_a_finite_plan_within_the_limit_passes() -> None:
    for passing in (OnnxController.of(shipped()), planning(LIMIT), planning(-LIMIT)):
        # Between two pieces the bus is answered; there is one for each graph and window.
        assert len(list(self_test(shipped(), passing))) == 5
    controllers: tuple[Controller, ...] = (
        *(planning(value) for value in (float("nan"), float("inf"), 1.01 * LIMIT, -1.01 * LIMIT)),
        *(planning(0.0, length=3), planning(0.0, forces=np.full((HORIZON, 2), np.nan)), FAILING),
    )
    for controller in controllers:
        with pytest.raises(ControllerError):
            list(self_test(shipped(), controller))


@pytest.mark.slow
def test_a_release_that_fails_it_is_logged_and_can_be_given_up(tmp_path: Path) -> None:
    provision(tmp_path / "ecu", image("first"))

    def controller_of(bundle: Bundle):
        return FAILING if bundle.manifest.name == "second" else RecordingController()

    rig = Rig(tmp_path / "ecu", controller_of=controller_of)
    rig.programming()
    rig.good(SELF_TEST)
    rig.start(image("second"))
    rig.programming()
    assert (rig.ask(SELF_TEST)[2], rig.log.names()[-1]) == (0x72, "self_test_failed")
    assert rig.ask(CONFIRM_ROUTINE)[2] == 0x24
    rig.good(REVERT)
    rig.reset()
    assert rig.ecu.cycle.boot.bundle is not None and rig.ecu.cycle.boot.bundle.name == "first"


@pytest.mark.slow
def test_a_release_for_another_vehicle_is_refused(rig: Rig) -> None:
    assert rig.write(image("second", control_period=0.1)) is Verdict.WRONG_PERIOD
    fit, bundle = VehicleFit(Config(), OnnxController.of), shipped()
    assert fit.fits(bundle) is Verdict.GOOD
    other = replace(bundle, manifest=replace(bundle.manifest, action_limit=0.2), digest="1")
    assert fit.fits(other) is Verdict.WRONG_VEHICLE
    # One whose graph has other sizes than its manifest states, and one whose estimator is no estimator.
    wider = replace(bundle, manifest=replace(bundle.manifest, window=33), digest="2")
    for damaged in (wider, replace(bundle, files={**bundle.files, ESTIMATOR: bundle.files[CONTROLLER]}, digest="3")):
        assert fit.fits(damaged) is Verdict.DAMAGED
