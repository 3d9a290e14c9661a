import numpy as np

from contract import sensors
from firmware_sim.ecu.bundle_policy import BundlePolicy


def test_it_shows_the_controller_what_the_ecu_would(bundle_of, recording_controller):
    bundle = bundle_of()
    controller = recording_controller(lambda i: 0.01 * (i + 1))
    policy = BundlePolicy(bundle, controller)
    window, horizon = bundle.manifest.window, bundle.manifest.mpc.horizon
    memory, rng = policy.start(), np.random.default_rng(1)
    seen = []
    columns = sensors.TRUCK.indices(bundle.manifest.sensors)
    for k in range(window + 3):
        Cp, action = rng.normal(size=sensors.COUNT), float(rng.normal())
        seen.append([*Cp[columns], action])
        kept = memory.copy()
        command, after = policy.step(memory, Cp, action)
        assert np.array_equal(memory, kept)
        memory = after
        assert len(controller.calls) == max(0, k - window + 2)
        if k < window - 1:
            assert command == 0.0
            continue
        shown, plan, free = controller.calls[-1]
        assert np.array_equal(shown, seen[-window:])
        # The last plan as it came out; at first, none.
        assert plan.tolist() == ([0.0] * horizon if k == window - 1 else [0.01 * (i + 1) for i in range(horizon)])
        assert free.tolist() == [1.0] * horizon
        assert command == 0.01


def test_memory_is_all_there_is(bundle_of, recording_controller):
    bundle = bundle_of()
    one = BundlePolicy(bundle, recording_controller())
    memory, rng = one.start(), np.random.default_rng(2)
    for _ in range(bundle.manifest.window + 1):
        _, memory = one.step(memory, rng.normal(size=sensors.COUNT), 0.02)
    Cp, controllers = rng.normal(size=sensors.COUNT), (recording_controller(), recording_controller())
    for controller in controllers:
        BundlePolicy(bundle, controller).step(memory, Cp, 0.03)
    for a, b in zip(*(controller.calls[0] for controller in controllers), strict=True):
        assert np.array_equal(a, b)
