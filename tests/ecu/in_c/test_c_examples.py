"""The frames that an example plays; that its ECU drives the jets by them is tested in `tests/ecu/examples`."""

import re

import numpy as np

from can_bridge.wire.message_sets import message_set
from can_bridge.wire.messages import VehicleSpeed
from contract.config.operating_point import OperatingPoint
from contract.config.tree import Config
from contract.config.vehicle import BusConfig
from ecu.in_c.c_examples import played_pressures
from tests.each import each


@each("frames", ["fd", "classic"])
def test_what_the_wire_cannot_carry_is_limited_or_unknown(frames):
    config = Config(bus=BusConfig(frames=frames), operating_point=OperatingPoint(speed=350.0))
    messages = message_set(config.bus)
    table = played_pressures(np.array([[1e6, -1e6, 0.0, 0.0, 0.0]]), config).decode()
    lines = re.findall(r"^    \{(.*?)\}", table, flags=re.MULTILINE)
    played = [bytes(int(byte, 16) for byte in line.split(", ")) for line in lines]
    pressure, limit = messages.pressure.parse(played[0]), messages.pressure_limit_pa
    assert pressure is not None
    np.testing.assert_allclose(pressure.pressure_pa, [limit, -limit, 0, 0])
    assert messages.speed.parse(played[1]) == VehicleSpeed(speed_m_per_s=None, age_ns=0)
