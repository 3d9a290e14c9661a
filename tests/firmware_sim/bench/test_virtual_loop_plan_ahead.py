"""The loop with an ECU that plans ahead: commands act at the period's boundary, wherever in the period they came."""

from can_bridge.wire.message_specs import JET_COMMAND
from can_bridge.wire.messages import Mode
from tests.each import each
from tests.firmware_sim.bench.harness import WARM

AHEAD = WARM + 1
"""The first command acts a period later."""


@each("compute_ms", [0.0, 8.0, 19.0])
def test_each_command_is_the_target_of_the_next_period_from_its_start(harness, compute_ms):
    h = harness(compute_ms, plan_ahead=True)
    rows = h.run(20)
    commands = [row.command for row in rows]
    assert h.targets()[AHEAD:] == commands[AHEAD - 1 : -1]
    assert len(set(commands[WARM:])) == 20 - WARM
    assert set(h.starts().values()) == {0}
    assert {row.mode for row in rows[WARM:]} == {Mode.CONTROL}


def test_the_flow_does_not_depend_on_when_the_command_comes(harness):
    """As long as it comes within its period: the reason to plan ahead."""
    seen = set()
    for compute_ms in (0.0, 3.0, 8.0, 15.0, 19.0):
        h = harness(compute_ms, plan_ahead=True)
        seen.add(tuple(row.sample.Cl for row in h.run(30)))
    assert len(seen) == 1
    without = {tuple(row.sample.Cl for row in harness(ms).run(30)) for ms in (0.0, 19.0)}
    assert len(without) == 2


def test_a_command_that_misses_its_boundary_leaves_the_jets_for_a_period(harness):
    h = harness(19.9, plan_ahead=True)
    rows = h.run(20)
    # It is through in the period after the one it was computed in, and acts in the one after that.
    assert min(end - (k + 1) * h.config.period_ns for k, end in enumerate(h.ends(JET_COMMAND))) > 0
    assert h.targets()[AHEAD + 1 :] == [row.command for row in rows[AHEAD - 1 : -2]]
