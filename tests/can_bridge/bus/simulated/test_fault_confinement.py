"""Rule by rule: CAN Specification 2.0 (Bosch), part B, chapter 8, which ISO 11898-1 took over."""

from hypothesis import given
from hypothesis import strategies as st

from can_bridge.bus.interface import BusState
from can_bridge.bus.simulated.fault_confinement import FaultConfinement

ACTIVE, PASSIVE, OFF = BusState.ERROR_ACTIVE, BusState.ERROR_PASSIVE, BusState.BUS_OFF


def counters(faults: FaultConfinement) -> tuple[int, int]:
    return faults.tx_errors, faults.rx_errors


def test_rules_1_to_5_and_7_and_8_count_one_event():
    def of(tx: int, rx: int) -> FaultConfinement:
        return FaultConfinement(tx_errors=tx, rx_errors=rx)

    for rule, after, expected in [
        ("1: a receive error", of(5, 7).receive_error(), (5, 8)),
        ("2: a dominant bit behind the own flag", of(0, 1).dominant_after_flag(), (0, 9)),
        ("3: a transmit error", of(5, 7).transmit_error(), (13, 7)),
        *(
            (f"3: no acknowledgement at {tx}", of(tx, 0).transmit_error(only_unacknowledged=True), (counted, 0))
            for tx, counted in [(0, 8), (120, 128), (127, 135), (128, 128), (255, 255)]
        ),
        *(
            (
                f"3: a stuff bit of the identifier at {tx}",
                of(tx, 0).transmit_error(only_arbitration_stuff=True),
                (tx, 0),
            )
            for tx in [0, 100, 200]
        ),
        ("4: a bit error in the own flag", of(0, 0).flag_overwritten(transmitting=True), (8, 0)),
        ("5: the same of a receiver", of(0, 0).flag_overwritten(transmitting=False), (0, 8)),
        *((f"7: sent at {tx}", of(tx, 3).transmitted(), (max(tx - 1, 0), 3)) for tx in [0, 1, 8, 255]),
        *((f"8: received at {rx}", of(3, rx).received(), (3, max(rx - 1, 0))) for rx in [0, 1, 127]),
    ]:
        assert counters(after) == expected, rule
    for rx in [128, 135, 255]:
        assert 119 <= of(0, rx).received().rx_errors <= 127, f"8: received at {rx}"


def test_rule_6_a_bus_that_stays_dominant_counts_eight_every_eight_bits():
    for bits, passive_flag, counted in [
        *((13, False, 0), (14, False, 8), (21, False, 8), (22, False, 16), (30, False, 24)),
        *((7, True, 0), (8, True, 8), (15, True, 8), (16, True, 16), (24, True, 24)),
    ]:
        for transmitting, expected in ((True, (counted, 0)), (False, (0, counted))):
            held = FaultConfinement().held_dominant(bits, transmitting=transmitting, passive_flag=passive_flag)
            assert counters(held) == expected, (bits, passive_flag, counted)


def test_rules_9_and_11_passive_from_128_on_and_active_again_below():
    for tx_errors, rx_errors, state in [(127, 127, ACTIVE), (128, 0, PASSIVE), (0, 128, PASSIVE), (255, 255, PASSIVE)]:
        assert FaultConfinement(tx_errors=tx_errors, rx_errors=rx_errors).state is state, (tx_errors, rx_errors, state)


def test_rules_10_and_12_bus_off_from_256_transmit_errors_on_until_the_recovery():
    assert FaultConfinement(tx_errors=247).transmit_error().state is PASSIVE
    off = FaultConfinement(tx_errors=248, rx_errors=90).transmit_error()
    assert (off.state, off.times_off) == (OFF, 1)
    # It stays off whatever happens, and counts once.
    assert off.transmitted().received().transmit_error().state is OFF
    assert off.transmit_error().times_off == 1
    assert off.recovered() == FaultConfinement(times_off=1)
    assert off.recovered().state is ACTIVE


STEPS = st.sampled_from(
    [
        FaultConfinement.receive_error,
        FaultConfinement.dominant_after_flag,
        FaultConfinement.transmit_error,
        FaultConfinement.transmitted,
        FaultConfinement.received,
        lambda faults: faults.transmit_error(only_unacknowledged=True),
    ]
)


@given(steps=st.lists(STEPS, max_size=300))
def test_counters_and_state_agree_after_any_sequence(steps):
    faults = FaultConfinement()
    for step in [*steps, *[FaultConfinement.dominant_after_flag] * 40]:
        was_off = faults.is_off
        faults = step(faults)
        assert faults.tx_errors >= 0
        assert 0 <= faults.rx_errors <= 255
        assert faults.is_off >= was_off
        if not faults.is_off:
            assert faults.tx_errors < 256
            passive = faults.tx_errors >= 128 or faults.rx_errors >= 128
            assert (faults.state is PASSIVE) == passive
