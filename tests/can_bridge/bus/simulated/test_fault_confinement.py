"""Rule by rule: CAN Specification 2.0 (Bosch), part B, chapter 8, which ISO 11898-1 took over."""

from hypothesis import given
from hypothesis import strategies as st

from can_bridge.bus.interface import BusState
from can_bridge.bus.simulated.fault_confinement import FaultConfinement


def counters(faults: FaultConfinement) -> tuple[int, int]:
    return faults.tx_errors, faults.rx_errors


def test_rule_1_a_receive_error_counts_one():
    assert counters(FaultConfinement(tx_errors=5, rx_errors=7).receive_error()) == (5, 8)


def test_rule_2_a_dominant_bit_behind_the_own_flag_counts_eight_more():
    assert counters(FaultConfinement(rx_errors=1).dominant_after_flag()) == (0, 9)


def test_rule_3_a_transmit_error_counts_eight():
    assert counters(FaultConfinement(tx_errors=5, rx_errors=7).transmit_error()) == (13, 7)


def test_rule_3_first_exception_a_passive_node_does_not_count_a_missing_acknowledgement():
    for tx_errors, counted in [(0, 8), (120, 128), (127, 135), (128, 128), (255, 255)]:
        faults = FaultConfinement(tx_errors=tx_errors)
        assert faults.transmit_error(only_unacknowledged=True).tx_errors == counted, (tx_errors, counted)


def test_rule_3_second_exception_a_stuff_bit_in_the_identifier_does_not_count():
    for tx_errors in [0, 100, 200]:
        faults = FaultConfinement(tx_errors=tx_errors)
        assert faults.transmit_error(only_arbitration_stuff=True) == faults, tx_errors


def test_rules_4_and_5_a_bit_error_in_the_own_flag_counts_eight():
    assert counters(FaultConfinement().flag_overwritten(transmitting=True)) == (8, 0)
    assert counters(FaultConfinement().flag_overwritten(transmitting=False)) == (0, 8)


def test_rule_6_a_bus_that_stays_dominant_counts_eight_every_eight_bits():
    for bits, passive_flag, counted in [
        *((13, False, 0), (14, False, 8), (21, False, 8), (22, False, 16), (30, False, 24)),
        *((7, True, 0), (8, True, 8), (15, True, 8), (16, True, 16), (24, True, 24)),
    ]:
        for transmitting, expected in ((True, (counted, 0)), (False, (0, counted))):
            found = FaultConfinement().held_dominant(bits, transmitting=transmitting, passive_flag=passive_flag)
            assert counters(found) == expected, (bits, passive_flag, counted)


def test_rule_7_success_takes_one_off_the_transmit_counter():
    for before, after in [(0, 0), (1, 0), (8, 7), (255, 254)]:
        assert counters(FaultConfinement(tx_errors=before, rx_errors=3).transmitted()) == (after, 3), (before, after)


def test_rule_8_success_takes_one_off_the_receive_counter():
    for before, after in [(0, 0), (1, 0), (127, 126)]:
        assert counters(FaultConfinement(tx_errors=3, rx_errors=before).received()) == (3, after), (before, after)


def test_rule_8_from_above_127_it_falls_into_119_to_127():
    for before in [128, 135, 255]:
        assert 119 <= FaultConfinement(rx_errors=before).received().rx_errors <= 127, before


def test_rules_9_and_11_passive_from_128_on_and_active_again_below():
    for tx_errors, rx_errors, state in [
        (127, 127, BusState.ERROR_ACTIVE),
        (128, 0, BusState.ERROR_PASSIVE),
        (0, 128, BusState.ERROR_PASSIVE),
        (255, 255, BusState.ERROR_PASSIVE),
    ]:
        assert FaultConfinement(tx_errors=tx_errors, rx_errors=rx_errors).state is state, (tx_errors, rx_errors, state)


def test_rule_10_bus_off_from_256_transmit_errors_on_and_only_from_those():
    last = FaultConfinement(tx_errors=247)
    assert last.transmit_error().state is BusState.ERROR_PASSIVE
    off = FaultConfinement(tx_errors=248).transmit_error()
    assert (off.state, off.times_off) == (BusState.BUS_OFF, 1)
    # It stays off whatever happens, and counts once.
    assert off.transmitted().received().transmit_error().state is BusState.BUS_OFF
    assert off.transmit_error().times_off == 1
    deaf = FaultConfinement()
    for _ in range(1000):
        deaf = deaf.dominant_after_flag()
    assert deaf.state is BusState.ERROR_PASSIVE
    assert deaf.rx_errors <= 255


def test_rule_12_recovery_clears_both_counters_and_not_the_count():
    off = FaultConfinement(tx_errors=250, rx_errors=90).transmit_error()
    assert off.recovered() == FaultConfinement(times_off=1)
    assert off.recovered().state is BusState.ERROR_ACTIVE


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
    for step in steps:
        was_off = faults.is_off
        faults = step(faults)
        assert faults.tx_errors >= 0
        assert 0 <= faults.rx_errors <= 255
        assert faults.is_off >= was_off
        if not faults.is_off:
            assert faults.tx_errors < 256
            passive = faults.tx_errors >= 128 or faults.rx_errors >= 128
            assert (faults.state is BusState.ERROR_PASSIVE) == passive
