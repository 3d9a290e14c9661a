from contract.config.operating_point import OperatingPoint


def test_default_truck():
    """2.5 m at 25 m/s in air of 1.2 kg/m3, worked out by hand."""
    point = OperatingPoint()
    assert point.convective_time == 0.1
    assert point.dynamic_pressure == 375.0
    assert point.flow_rate_scale == 62.5
    assert point.period_ns(0.2) == 20_000_000
