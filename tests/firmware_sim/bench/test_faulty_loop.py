"""The loop of a run with faults at its nodes' ports."""

from dataclasses import replace

import pytest

from can_bridge.bus.faults.loss import Drop
from can_bridge.bus.faults.timing import Delay
from can_bridge.bus.faults.wrapping import wrap
from can_bridge.bus.simulated.medium import SimulatedBus
from can_bridge.wire.message_specs import JET_COMMAND, PRESSURE
from can_bridge.wire.messages import Mode
from contract.config.tree import Config
from contract.config.vehicle import EcuConfig
from firmware_sim.bench.vehicle_node import VehicleNode
from firmware_sim.bench.virtual_loop import BusPorts, VirtualLoop
from firmware_sim.ecu.ecu import Ecu
from tests.firmware_sim.bench.harness import Oscillator
from tests.firmware_sim.bench.test_faulty_bus import NAMES, START, during


def in_virtual_time(bundle, controller, periods: int, *, vehicle=(), ecu=()):
    """Rows and totals of the loop as a run has it, its ports wrapped."""
    config = Config(ecu=EcuConfig(compute_time_ms=8.0))
    bus = SimulatedBus(config.bus)
    ports = BusPorts(
        vehicle=wrap(bus.port("vehicle"), vehicle, lambda: bus.now_ns),
        ecu=wrap(bus.port("ecu"), ecu, lambda: bus.now_ns),
    )
    plant = Oscillator(config.flow.substeps)
    loop = VirtualLoop(plant, VehicleNode(NAMES, config), Ecu(bundle, controller, config), bus, ports, config)
    # Raised once: a request that stands at power-on is none.
    return [loop.period(enable_request=k > 0) for k in range(periods)], loop.totals()


def test_the_loop_of_a_run_takes_wrapped_ports(bundle_of, recording_controller):
    lost = during(Drop(probability=1.0, frame_ids=(PRESSURE.frame_id,)), 3)
    for side in ({"vehicle": (lost,)}, {"ecu": (replace(lost, at="receive"),)}):
        rows, totals = in_virtual_time(bundle_of(), recording_controller(), START + 10, **side)
        assert [row.mode for row in rows[START - 1 : START + 4]] == [
            Mode.CONTROL,
            Mode.HOLD,
            Mode.DECAY,
            Mode.DECAY,
            Mode.CONTROL,
        ]
        assert (totals.lost, totals.rejected) == (3, 0)


def test_delayed_commands_act_later_in_the_same_period(bundle_of, recording_controller):
    late = Delay(delay_s=0.003, frame_ids=(JET_COMMAND.frame_id,))
    plain, _ = in_virtual_time(bundle_of(), recording_controller(), 30)
    delayed, totals = in_virtual_time(bundle_of(), recording_controller(), 30, vehicle=(late,))
    # The flow differs, so the pressures do, and with them the stuff bits: some, of half a microsecond each.
    ages = [[row.age_ms for row in rows[START:]] for rows in (plain, delayed)]
    assert ages[1] == pytest.approx([age + 3.0 for age in ages[0]], abs=0.02)
    assert [row.command for row in delayed[START:]] == [row.command for row in plain[START:]]
    assert totals.lost == 0
