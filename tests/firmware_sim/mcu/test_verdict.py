"""Does a control step fit? Times and periods by hand."""

from contract.config.operating_point import OperatingPoint
from contract.config.tree import Config
from firmware_sim.mcu.verdict import period_ms, verdicts


def test_the_period_is_that_of_the_operating_point():
    assert period_ms(Config()) == 20.0
    # Twice the speed, half the time.
    assert period_ms(Config(operating_point=OperatingPoint(speed=50.0))) == 10.0


def test_the_verdict_names_the_factor():
    for needed, said in [
        (55.9, "DOES NOT FIT: 2.8 times the period"),
        (20.0, "fits: 100 % of the period"),
        (5.0, "fits: 25 %"),
    ]:
        rows = dict(verdicts({"480": needed}, 20.0))
        assert rows["control period"].startswith("20 ms"), needed
        assert rows["at 480 MHz, by the model"].startswith(said), needed
