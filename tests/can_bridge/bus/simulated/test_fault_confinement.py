"""Rule by rule: CAN Specification 2.0 (Bosch), part B, chapter 8, which ISO 11898-1 took over."""

from can_bridge.bus.interface import BusState
from can_bridge.bus.simulated.fault_confinement import FaultConfinement

ACTIVE, PASSIVE, OFF = BusState.ERROR_ACTIVE, BusState.ERROR_PASSIVE, BusState.BUS_OFF


def counters(faults: FaultConfinement) -> tuple[int, int]:
    return faults.tx_errors, faults.rx_errors


def test_rules_1_to_3_and_7_and_8_count_one_event():
    def of(tx: int, rx: int) -> FaultConfinement:
        return FaultConfinement(tx_errors=tx, rx_errors=rx)

    for rule, after, expected in [
        ("1: a receive error", of(5, 7).receive_error(), (5, 8)),
        ("2: a dominant bit behind the own flag", of(0, 1).dominant_after_flag(), (0, 9)),
        ("2: a register of eight bits", of(0, 250).dominant_after_flag(), (0, 255)),
        ("3: a transmit error", of(5, 7).transmit_error(), (13, 7)),
        *(
            (f"3: no acknowledgement at {tx}", of(tx, 0).unacknowledged(), (counted, 0))
            for tx, counted in [(0, 8), (120, 128), (127, 135), (128, 128), (255, 255)]
        ),
        *((f"7: sent at {tx}", of(tx, 3).transmitted(), (max(tx - 1, 0), 3)) for tx in [0, 1, 8, 255]),
        *((f"8: received at {rx}", of(3, rx).received(), (3, max(rx - 1, 0))) for rx in [0, 1, 127]),
    ]:
        assert counters(after) == expected, rule
    for rx in [128, 135, 255]:
        assert 119 <= of(0, rx).received().rx_errors <= 127, f"8: received at {rx}"


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
