import math

from hypothesis import given
from hypothesis import strategies as st

from contract.config.operating_point import OperatingPoint


def test_default_truck():
    """2.5 m at 25 m/s in air of 1.2 kg/m3, worked out by hand."""
    point = OperatingPoint()
    assert point.convective_time == 0.1
    assert point.dynamic_pressure == 375.0
    assert point.flow_rate_scale == 62.5
    assert point.period_ns(0.2) == 20_000_000


@given(speed=st.floats(1.0, 100.0), factor=st.floats(1.1, 4.0))
def test_faster_truck_shortens_time_and_scales_pressure_and_flow(speed, factor):
    slow, fast = OperatingPoint(speed=speed), OperatingPoint(speed=speed * factor)
    assert math.isclose(slow.convective_time, factor * fast.convective_time)
    assert math.isclose(slow.dynamic_pressure * factor**2, fast.dynamic_pressure)
    assert math.isclose(slow.flow_rate_scale * factor, fast.flow_rate_scale)
