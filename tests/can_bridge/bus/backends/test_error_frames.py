"""With the numbers of `linux/can/error.h`, written here as the header has them."""

from can_bridge.bus.backends.python_can import health_after, lost_frames
from can_bridge.bus.interface import HEALTHY, BusHealth, BusState

TX_TIMEOUT, LOSTARB, CRTL, PROT, ACK = 0x001, 0x002, 0x004, 0x008, 0x020
BUSOFF, BUSERROR, RESTARTED, CNT = 0x040, 0x080, 0x100, 0x200
"""CAN_ERR_..."""
RX_OVERFLOW, TX_OVERFLOW, RX_WARNING, TX_WARNING = 0x01, 0x02, 0x04, 0x08
RX_PASSIVE, TX_PASSIVE, CRTL_ACTIVE = 0x10, 0x20, 0x40
"""CAN_ERR_CRTL_..."""

ACTIVE, PASSIVE, OFF = BusState.ERROR_ACTIVE, BusState.ERROR_PASSIVE, BusState.BUS_OFF


def data(controller: int = 0, tx: int = 0, rx: int = 0) -> bytes:
    return bytes([0, controller, 0, 0, 0, 0, tx, rx])


def after(*frames: tuple[int, bytes]) -> BusHealth:
    health = HEALTHY
    for classes, content in frames:
        health = health_after(health, classes, content)
    return health


def test_state_and_counters_of_the_controller():
    for controller, state in [
        *((controller, ACTIVE) for controller in (RX_WARNING, TX_WARNING, TX_OVERFLOW, CRTL_ACTIVE)),
        *((controller, PASSIVE) for controller in (RX_PASSIVE, TX_PASSIVE, RX_PASSIVE | TX_PASSIVE)),
    ]:
        health = after((CRTL | CNT, data(controller, 100, 17)))
        assert health == BusHealth(state=state, tx_errors=100, rx_errors=17), controller
    # Passive by its transmit errors, it reports a warning of its receive errors.
    assert after((CRTL, data(TX_PASSIVE)), (CRTL, data(RX_WARNING))).state is PASSIVE
    assert after((CRTL, data(TX_PASSIVE)), (CRTL, data(CRTL_ACTIVE))).state is ACTIVE


def test_bus_off_is_counted_until_the_restart_and_across_it():
    off = (BUSOFF | CNT, data(tx=248))
    assert after(off) == BusHealth(state=OFF, tx_errors=248, bus_off=1)
    assert after(off, (CRTL, data(TX_PASSIVE))).state is OFF
    assert after(off, (RESTARTED, data())) == BusHealth(bus_off=1)
    assert after(off, (RESTARTED, data()), off) == BusHealth(state=OFF, tx_errors=248, bus_off=2)


def test_older_kernels_give_counters_without_the_flag():
    assert after((CRTL, data(RX_WARNING, 0, 96))).rx_errors == 96
    # Zeros may mean that the driver does not know.
    known = (CRTL | CNT, data(0, 5, 6))
    assert after(known, (CRTL, data(RX_WARNING))).rx_errors == 6
    assert after(known, (CRTL | CNT, data())) == HEALTHY


def test_other_classes_do_not_concern_the_controller():
    assert lost_frames(CRTL, data(RX_OVERFLOW))
    assert not lost_frames(CRTL, data(TX_OVERFLOW))
    for classes in [TX_TIMEOUT, LOSTARB, PROT, ACK, BUSERROR]:
        # Byte 1 means other things there.
        assert after((classes, data(TX_PASSIVE))) == HEALTHY, classes
        assert not lost_frames(classes, data(RX_OVERFLOW)), classes
