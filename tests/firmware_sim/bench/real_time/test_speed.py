"""Whether a live wake keeps up."""

from typing import Any

import pytest

from contract.config.plant import FlowConfig
from contract.errors import PlantError
from firmware_sim.bench.real_time.live_wake import Speed
from wake.truck.state import State
from wake.truck.truck_wake import TruckWake


def test_a_wake_that_does_not_keep_up_is_refused_with_the_remedy_and_one_that_only_just_does_is_warned_of() -> None:
    coarse: dict[str, Any] = {"refinement": 0.75, "substeps": 15}
    assert Speed(10.0, 11.0).check(20.0, **coarse) is None
    for times in ((19.0, 19.5), (10.0, 25.0)):
        assert "periods without pressures are to be expected" in str(Speed(*times).check(20.0, **coarse)), times
    with pytest.raises(
        PlantError,
        match=r"takes 72\.0 ms for a control period of 20 ms .*refinement = 1, flow\.substeps = 30.*: it cannot keep up"
        r"\. .*--set flow\.refinement=0\.75 --set flow\.substeps=15\), or a vehicle 4 times as slow",
    ):
        Speed(72.0, 90.0).check(20.0, refinement=1.0, substeps=30)
    # The advice is no grid that is in use already; and what it names would do.
    with pytest.raises(PlantError, match=r"longer steps, or a vehicle 1\.7 times as slow") as caught:
        Speed(30.0, 30.0).check(20.0, **coarse)
    assert "refinement=" not in str(caught.value)
    assert Speed(30.0, 30.0).check(1.7 * 20.0, **coarse) is None


def test_the_measurement_leaves_the_wake_as_it_was() -> None:
    wake = TruckWake(FlowConfig(refinement=0.4, substeps=12))
    wake.reset(State(flat=wake.solver.start().flat, substep=0, action=0.0))
    wake.solver.run(wake.flow, dt=1e-4, steps=200, action_from=0.0, action_to=0.0)
    begin = wake.state()
    ticks = iter([0.0, 0.011, 1.0, 1.013])
    assert Speed.of(wake, 2, lambda: next(ticks)) == pytest.approx((12.0, 13.0))
    assert (wake.state().flat == begin.flat).all()
    assert wake.t == 0.0
