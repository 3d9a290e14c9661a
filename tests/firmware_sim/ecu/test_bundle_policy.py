import numpy as np

from contract import sensors
from firmware_sim.ecu.bundle_policy import BundlePolicy


def test_it_shows_the_controller_what_the_ecu_would_and_keeps_nothing_but_its_memory(bundle_of, recording_controller):
    bundle = bundle_of()
    controller = recording_controller(lambda i: 0.01 * (i + 1))
    window, horizon = bundle.manifest.window, bundle.manifest.mpc.horizon
    memory, rng = BundlePolicy(bundle, controller).start(), np.random.default_rng(1)
    rows = []
    columns = sensors.TRUCK.indices(bundle.manifest.sensors)
    for k in range(window + 3):
        Cp, action = rng.normal(size=sensors.COUNT), float(rng.normal())
        rows.append([*Cp[columns], action])
        kept = memory.copy()
        command, after = BundlePolicy(bundle, controller).step(memory, Cp, action)
        assert np.array_equal(memory, kept)
        memory = after
        assert len(controller.calls) == max(0, k - window + 2)
        if k < window - 1:
            assert command == 0.0
            continue
        shown, plan, free = controller.calls[-1]
        assert np.array_equal(shown, rows[-window:])
        # The last plan as it came out; at first, none.
        assert plan.tolist() == ([0.0] * horizon if k == window - 1 else [0.01 * (i + 1) for i in range(horizon)])
        assert free.tolist() == [1.0] * horizon
        assert command == 0.01
