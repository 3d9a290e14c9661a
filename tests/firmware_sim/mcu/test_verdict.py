"""Does a control step fit? Times by hand."""

from firmware_sim.mcu.verdict import verdicts


def test_the_verdict_names_the_factor():
    for needed, said in [
        (55.9, "DOES NOT FIT: 2.8 times the period"),
        (20.0, "fits: 100 % of the period"),
        (5.0, "fits: 25 %"),
    ]:
        rows = dict(verdicts({"480": needed}, 20.0))
        assert rows["control period"].startswith("20 ms"), needed
        assert rows["at 480 MHz, by the model"].startswith(said), needed
