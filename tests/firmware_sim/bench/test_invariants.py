"""Runs in which ECU or vehicle do wrong on purpose are caught, by the right invariant; sound ones are clean.

`tests/proofs/ecu/test_judges.py` plants every defect of a vehicle before the same judge of its jets.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from can_bridge.e2e.profiles import profile_of
from can_bridge.wire import codec
from can_bridge.wire.message_specs import JET_COMMAND
from can_bridge.wire.messages import JetCommand, Mode
from contract.config.tree import Config
from contract.config.vehicle import BackgroundConfig, BusConfig, EcuConfig, VehicleConfig
from ecu.ecu import Ecu
from ecu.fail_safe import FailSafe, OperatingMode
from firmware_sim.bench import simulation
from firmware_sim.bench.disturbances import Disturbances
from firmware_sim.bench.invariants import Invariants
from tests.each import each
from tests.examples import examples
from tests.firmware_sim.bench.harness import DEFAULT, Run

CONFIGS = {
    "default": Config(),
    "at once": Config(ecu=EcuConfig(plan_ahead=False)),
    "late actuator": Config(vehicle=VehicleConfig(actuator_delay=3)),
    "slow driver": Config(vehicle=VehicleConfig(action_step=0.01)),
    "slow gate": Config(ecu=EcuConfig(command_step=0.01)),
    "classic": Config(bus=BusConfig(frames="classic")),
    "busy": Config(bus=BusConfig(background=BackgroundConfig(load=0.8))),
    "no hold": Config(ecu=EcuConfig(hold_periods=0, decay_periods=0)),
}
HARM = (
    *("noise:level=0.9", "dead:sensor=base_0@0.5..", "wire_errors:bit_error_rate=0.002"),
    *("wire_errors:bit_error_rate=1,node=ecu@0.6..0.61", "wire_errors:bit_error_rate=0.01,node=vehicle,at=receive"),
    *("reset@0.5", "reset:boot_s=0@0.5055", "clock:ppm=200", "clock:offset_s=-0.1@0.5.."),
    *("clock:offset_s=0.1@0.5..0.7", "no_request@0.6..0.7", "no_request@0.8..0.9", "operating_point:speed=30"),
    *("action_limit=0.5@0.5..", "stuck_jets=-0.5@0.5.."),
    *(
        f"{node}:{fault}"
        for node in ("ecu", "vehicle")
        for fault in (
            *("drop:probability=0.3", "drop:probability=0.4,at=receive", "burst_loss:loss=0.3,mean_burst=4"),
            *("duplicate:probability=0.5", "delay:delay_s=0.01,jitter_s=0.05", "delay:delay_s=0.03,restamp=false"),
            *("reorder:window=3", "flip_bits:probability=0.3", "flip_bits:probability=0.3,before_crc=true"),
            *("stuck_at@0.6..0.8", "stuck_at:counter_runs=true@0.6..0.8", "babble@0.6..0.7", "disconnect@0.6..0.7"),
            "slow_consumer@0.5..",
        )
    ),
)


def violations(*texts: str, config: Config = DEFAULT, seed: int = 0):
    """What breaks in a run of a stub controller on an oscillator, with everything else real; and the run."""
    observer = Invariants.of(config, Disturbances.parse(texts))
    return observer.violations, Run(*texts, config=config, observer=observer, seed=seed).log


def names(*texts: str, config: Config = DEFAULT) -> set[str]:
    return {one.invariant for one in violations(*texts, config=config)[0]}


@each("config", CONFIGS.values())
@pytest.mark.slow
def test_a_sound_run_breaks_nothing_and_moves_the_jets(config):
    broken, log = violations(config=config)
    assert broken == []
    assert abs(log.series["action"]).max() > 0.02


@pytest.mark.slow  # many runs
@examples(24)
@given(
    st.lists(st.sampled_from(HARM), min_size=1, max_size=3, unique=True),
    st.sampled_from([config for name, config in CONFIGS.items() if name != "busy"]),
    st.integers(0, 1000),
)
@example(["wire_errors:bit_error_rate=0.02,at=receive"], DEFAULT, 0)
@example(["ecu:reorder:window=3", "vehicle:stuck_at@0.6..0.8"], DEFAULT, 0)
@example(["ecu:clock_drift:ppm=20000", "ecu:delay:delay_s=0.015,jitter_s=0.03,restamp=false"], DEFAULT, 0)
def test_nothing_is_broken_whatever_disturbs_the_run(texts, config, seed):
    assert violations(*texts, config=config, seed=seed)[0] == []


def wrong_ecu(monkeypatch, change: Callable[[JetCommand, int], JetCommand]) -> None:
    """Have every ECU send something else, with a protection that fits; `change` has the number of the step."""

    class Wrong(Ecu):
        steps = 0

        def step(self, now_ns, frames, *rest, **more):
            command, status = super().step(now_ns, frames, *rest, **more)
            sent = codec.parse_jet_command(command.data)
            assert sent is not None
            self.steps += 1
            data = codec.emit_jet_command(change(sent, self.steps))
            profile = profile_of(JET_COMMAND)
            data = profile.protect(data, data_id=JET_COMMAND.data_id, counter=profile.counter_of(command.data))
            return [replace(command, data=data), status]

    monkeypatch.setattr(simulation, "Ecu", Wrong)


def leaps(sent: JetCommand, step: int) -> JetCommand:
    return sent._replace(flow_m2_per_s=4.6 * (-1) ** step) if sent.mode is Mode.CONTROL else sent


def stale(sent: JetCommand, step: int, by: int) -> JetCommand:
    if sent.pressure_counter is None or sent.mode is not Mode.CONTROL:
        return sent
    return sent._replace(pressure_counter=(sent.pressure_counter - by) % 256)


def test_a_wrong_command_is_caught(monkeypatch):
    faults: list[tuple[Callable[[JetCommand, int], JetCommand], set[str]]] = [
        # The vehicle does not follow it.
        (lambda sent, _: sent._replace(flow_m2_per_s=1.0) if sent.mode is Mode.OFF else sent, {"bus_bounds"}),
        # The first step of the wave is a whole one already.
        (lambda sent, _: sent._replace(flow_m2_per_s=sent.flow_m2_per_s * 1.1), {"bus_bounds", "bus_rate"}),
        (leaps, {"bus_rate"}),
        # The vehicle refuses what is older than its own bound, 5 periods.
        (partial(stale, by=2), {"bus_age"}),
        (partial(stale, by=7), {"bus_age"}),
        # Of pressures that were never sent.
        (lambda sent, _: sent._replace(pressure_counter=200), {"bus_age"}),
    ]
    for place, (change, broken) in enumerate(faults):
        with monkeypatch.context() as patched:
            wrong_ecu(patched, change)
            assert names() == broken, place


def test_control_without_an_edge_is_caught(monkeypatch):
    class Eager(Ecu):
        def step(self, now_ns, frames, *rest, **more):
            if self.state.fail_safe.mode in (OperatingMode.INIT, OperatingMode.STANDBY, OperatingMode.FAULT):
                # As if the request had been seen low: it rises in any frame that has it.
                self.restore(replace(self.state, fail_safe=FailSafe(mode=OperatingMode.ARMED, enable_request=False)))
            return super().step(now_ns, frames, *rest, **more)

    monkeypatch.setattr(simulation, "Ecu", Eager)
    assert names() == set()  # an ordinary run has its edge
    assert "enable_edge" in names("ecu:disconnect@0.5..0.7")
    assert "enable_edge" in names("reset@0.6")
