"""The pressures that an example plays, read back from the generated table."""

import re

import numpy as np

from can_bridge.e2e.receiver import E2eReceiver, FrameCheck
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import message_set
from can_bridge.wire.messages import VehicleSpeed
from contract.arrays import Array
from contract.config.operating_point import OperatingPoint
from contract.config.tree import Config
from contract.config.vehicle import BusConfig
from ecu.in_c.c_examples import ASKED_FROM, MOST_PERIODS, played_pressures
from tests.each import each

ROWS = np.random.default_rng(0).normal(scale=0.5, size=(MOST_PERIODS + 9, 5))


def frames_of(rows: Array, config: Config, *, speed: bool = False) -> list[Frame]:
    messages = message_set(config.bus)
    spec = messages.speed.spec if speed else messages.pressure.spec
    table = played_pressures(rows, config).decode().split("#if SW_PAST > 0")[speed]
    lines = re.findall(r"^    \{(.*?)\}", table, flags=re.MULTILINE)
    data = [bytes(int(byte, 16) for byte in line.split(", ")) for line in lines]
    return [Frame(frame_id=spec.frame_id, data=item, is_fd=spec.is_fd) for item in data]


@each("frames", ["fd", "classic"])
def test_each_row_is_a_sound_frame_with_its_pressures_and_one_with_the_design_speed(frames):
    config = Config(bus=BusConfig(frames=frames))
    messages = message_set(config.bus)
    receiver, of_speed = (E2eReceiver(message.spec, config.bus.e2e) for message in (messages.pressure, messages.speed))
    played, speeds = frames_of(ROWS, config), frames_of(ROWS, config, speed=True)
    assert len(played) == len(speeds) == MOST_PERIODS
    cruises = VehicleSpeed(speed_m_per_s=config.operating_point.speed, age_ns=0)
    for period, (frame, speed) in enumerate(zip(played, speeds, strict=True)):
        assert receiver.tick([frame]).checks == of_speed.tick([speed]).checks == (FrameCheck.OK,)
        assert messages.speed.parse(speed.data) == cruises
        pressure = messages.pressure.parse(frame.data)
        assert pressure is not None
        assert (pressure.enable_request, pressure.valid) == (period >= ASKED_FROM, (True,) * 4)
        # Half a step of the wire.
        half = 0.5 * messages.pressure_resolution_pa * (1 + 1e-9)
        expected = ROWS[period, :4] * config.operating_point.dynamic_pressure
        np.testing.assert_allclose(pressure.pressure_pa, expected, rtol=0, atol=half)
    # What the wire cannot carry is limited, and few rows are few frames.
    (frame,) = frames_of(np.array([[1e6, -1e6, 0.0, 0.0, 0.0]]), config)
    pressure, limit = messages.pressure.parse(frame.data), messages.pressure_limit_pa
    assert pressure is not None
    np.testing.assert_allclose(pressure.pressure_pa, [limit, -limit, 0, 0])
    config = Config(bus=BusConfig(frames=frames), operating_point=OperatingPoint(speed=350.0))
    assert messages.speed.parse(frames_of(ROWS, config, speed=True)[0].data) == VehicleSpeed(
        speed_m_per_s=None, age_ns=0
    )
