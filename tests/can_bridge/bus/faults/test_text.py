"""Faults from text and back, and what is refused with which words."""

from can_bridge.bus.faults.fault import BusFault, FrameFault, SidedFault
from can_bridge.bus.faults.frame_faults import BurstLoss, Delay, Drop, FlipBits, WireErrors
from can_bridge.bus.faults.node_faults import Babble, ClockDrift, Disconnect
from can_bridge.bus.faults.text import BUS_FAULTS, parse_fault, text_of
from contract.errors import ConfigError
from tests.refused import refused


def test_a_text_is_its_fault_and_back():
    ids = (0x120, 0x130)
    apart = "drop: probability = 1, frame_ids=0x120+304 @ ..1.5"
    babble = Babble(frame_id=16, length=64, is_fd=True)
    exact = "delay:delay_s=0.123456789012345"
    for text, fault, shortest in [
        ("drop:probability=0.1@5..10s", Drop(probability=0.1, start_s=5.0, end_s=10.0), "drop:probability=0.1@5..10"),
        (apart, Drop(probability=1.0, frame_ids=ids, end_s=1.5), "drop:frame_ids=288+304,probability=1@0..1.5"),
        ("burst_loss:loss=0.2,mean_burst=3@2..", BurstLoss(loss=0.2, mean_burst=3.0, start_s=2.0), ""),
        ("flip_bits:at=receive,bits=2,before_crc=true", FlipBits(bits=2, before_crc=True, at="receive"), ""),
        (f"{exact},restamp=false", Delay(delay_s=0.123456789012345, restamp=False), ""),
        ("disconnect", Disconnect(), ""),
        ("disconnect:kind=device_gone", Disconnect(kind="device_gone"), ""),
        ("babble:frame_id=0x10,length=64,is_fd=true", babble, "babble:frame_id=16,length=64,is_fd=true"),
        ("clock_drift:ppm=-100", ClockDrift(ppm=-100.0), ""),
    ]:
        assert parse_fault(text) == fault, text
        assert text_of(fault) == (shortest or text)
        assert parse_fault(text_of(fault)) == fault, text


def test_what_is_no_fault_is_refused_with_the_remedy():
    for text, message in [
        ("dorp@1..", r"fault 'dorp@1\.\.': no fault 'dorp'; there are drop, burst_loss, .*clock_drift"),
        ("burst_loss@1..", r"fault 'burst_loss@1\.\.': burst_loss needs loss, mean_burst$"),
        ("drop:rate=1", r"'rate=1' must be NAME=VALUE with a name of frame_ids, at, probability"),
        ("drop:probability=0.1,probability=1", r"probability is given twice$"),
        ("drop:probability=much", r"probability = 'much' must be a number"),
        ("flip_bits:bits=1.5", r"bits = '1\.5' must be a whole number"),
        ("flip_bits:before_crc=yes", r"before_crc = 'yes' must be true or false"),
        ("flip_bits:at=both", r"at = 'both' must be send or receive"),
        ("drop:probability=1,frame_ids=a", r"frame_ids = 'a' must be whole numbers with \+ between them"),
        ("disconnect@a..b", r"'a\.\.b' must be START\.\.END in seconds"),
        ("burst_loss:loss=0.9,mean_burst=2", r"burst_loss\.loss = 0\.9: must be at most 0\.666667"),
        ("babble:length=9,is_fd=true", r"babble\.length = 9: must be one of .* 12, 16"),
        ("clock_drift:ppm=-1e6", r"clock_drift\.ppm = -1000000\.0: must be above"),
        ("slow_consumer:queue=0", r"slow_consumer\.queue = 0: must be at least 1"),
        ("disconnect@9..5", r"disconnect\.end_s = 5\.0: must be in 9\.0\.\.1e\+12"),
    ]:
        with refused(ConfigError, message):
            parse_fault(text)
    # What no text can name.
    with refused(ConfigError, r"wire_errors\.bit_error_rate = 1\.1: must be in \[0, 1\]"):
        WireErrors(bit_error_rate=1.1)


def test_every_fault_has_a_text():
    """All concrete classes there are, by inheritance. `test_wrapping` makes one of each from its text."""

    def concrete(kind):
        return {kind}.union(*map(concrete, kind.__subclasses__())) - {BusFault, FrameFault, SidedFault}

    # An example has one of its own.
    own = {kind for kind in concrete(BusFault) if kind.__module__.startswith("can_bridge.")}
    assert set(BUS_FAULTS.values()) == own
