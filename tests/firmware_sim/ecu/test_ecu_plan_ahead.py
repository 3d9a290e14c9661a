"""An ECU that plans for the next period: what is settled, what it sends, and that a delay adds to it."""

import numpy as np
import pytest

from can_bridge.wire.message_specs import FLOW_RESOLUTION_M2_PER_S
from can_bridge.wire.messages import Mode
from contract.config.operating_point import OperatingPoint
from tests.each import each

WINDOW, HORIZON = 4, 5
SCALE = OperatingPoint().flow_rate_scale
QUANTUM = FLOW_RESOLUTION_M2_PER_S / SCALE


def numbered(recording_controller):
    """A controller none of whose actions comes twice, in steps of the wire."""
    counter = iter(range(10_000))
    return recording_controller(lambda i: 0.0016 * (next(counter) % 40))


@each("delay", [0, 1, 3])
def test_the_action_in_force_is_settled_and_the_one_after_it_is_sent(bench_of, recording_controller, delay):
    controller = numbered(recording_controller)
    bench = bench_of(controller, plan_ahead=True, delay_steps=delay)
    commands = bench.good(WINDOW + 8)
    settled = delay + 1
    assert all(command.next_period for command in commands)
    # reached[k]: by the jets at the end of period k; they follow each command in the period after, and late.
    reached = [0.0] * settled + [command.flow_m2_per_s / SCALE for command in commands]
    for number, (window, plan, free) in enumerate(controller.calls):
        k = WINDOW + number
        np.testing.assert_array_equal(free, [0.0] * settled + [1.0] * (HORIZON - settled))
        # The row of period j holds what the jets had reached when it was sampled, at the end of period j - 1.
        np.testing.assert_array_equal(window[:, 4], [0.0, *reached][k - WINDOW + 1 : k + 1])
        np.testing.assert_array_equal(plan[1 : settled + 1], reached[k : k + settled])
        # Sent now is what the plan has for as many periods from now as are settled.
        assert reached[k + settled] == pytest.approx(0.0016 * ((number * HORIZON + settled) % 40), abs=QUANTUM)
    assert len({command.flow_m2_per_s for command in commands[WINDOW:]}) > 5


def test_it_is_what_a_delay_of_a_period_would_be(bench_of, recording_controller):
    """Planning ahead is to know of one more period's delay: the same commands, but for the bit that says so."""
    ahead, late = (
        bench_of(numbered(recording_controller), plan_ahead=plan_ahead, delay_steps=delay).good(WINDOW + 8)
        for plan_ahead, delay in ((True, 1), (False, 2))
    )
    assert [command._replace(next_period=False) for command in ahead] == late
    assert ahead[-1].mode is Mode.CONTROL
    assert ahead[-1].flow_m2_per_s != 0.0
