"""With the numbers of `linux/can/error.h`, written here as the header has them."""

from hypothesis import given
from hypothesis import strategies as st

from can_bridge.bus.backends.error_frames import health_after, lost_frames
from can_bridge.bus.interface import HEALTHY, BusHealth, BusState

CAN_ERR_TX_TIMEOUT = 0x001
CAN_ERR_LOSTARB = 0x002
CAN_ERR_CRTL = 0x004
CAN_ERR_PROT = 0x008
CAN_ERR_ACK = 0x020
CAN_ERR_BUSOFF = 0x040
CAN_ERR_BUSERROR = 0x080
CAN_ERR_RESTARTED = 0x100
CAN_ERR_CNT = 0x200

CAN_ERR_CRTL_RX_OVERFLOW = 0x01
CAN_ERR_CRTL_TX_OVERFLOW = 0x02
CAN_ERR_CRTL_RX_WARNING = 0x04
CAN_ERR_CRTL_TX_WARNING = 0x08
CAN_ERR_CRTL_RX_PASSIVE = 0x10
CAN_ERR_CRTL_TX_PASSIVE = 0x20
CAN_ERR_CRTL_ACTIVE = 0x40

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
        (CAN_ERR_CRTL_RX_WARNING, ACTIVE),
        (CAN_ERR_CRTL_TX_WARNING, ACTIVE),
        (CAN_ERR_CRTL_TX_OVERFLOW, ACTIVE),
        (CAN_ERR_CRTL_RX_PASSIVE, PASSIVE),
        (CAN_ERR_CRTL_TX_PASSIVE, PASSIVE),
        (CAN_ERR_CRTL_RX_PASSIVE | CAN_ERR_CRTL_TX_PASSIVE, PASSIVE),
        (CAN_ERR_CRTL_ACTIVE, ACTIVE),
    ]:
        assert after((CAN_ERR_CRTL | CAN_ERR_CNT, data(controller, 100, 17))) == BusHealth(
            state=state, tx_errors=100, rx_errors=17
        ), (controller, state)


def test_warning_is_no_recovery():
    """A controller that is passive by its transmit errors reports a warning of its receive errors."""
    health = after(
        (CAN_ERR_CRTL, data(CAN_ERR_CRTL_TX_PASSIVE)),
        (CAN_ERR_CRTL, data(CAN_ERR_CRTL_RX_WARNING)),
    )
    assert health.state is PASSIVE


def test_bus_off_is_counted_until_the_restart_and_across_it():
    off = (CAN_ERR_BUSOFF | CAN_ERR_CNT, data(tx=248))
    assert after(off) == BusHealth(state=OFF, tx_errors=248, bus_off=1)
    assert after(off, (CAN_ERR_CRTL, data(CAN_ERR_CRTL_TX_PASSIVE))).state is OFF
    assert after(off, (CAN_ERR_RESTARTED, data())) == BusHealth(bus_off=1)
    assert after(off, (CAN_ERR_RESTARTED, data()), off) == BusHealth(state=OFF, tx_errors=248, bus_off=2)


def test_older_kernels_give_counters_without_saying_so():
    assert after((CAN_ERR_CRTL, data(CAN_ERR_CRTL_RX_WARNING, 0, 96))).rx_errors == 96
    # Zeros may mean that the driver does not know.
    told = (CAN_ERR_CRTL | CAN_ERR_CNT, data(0, 5, 6))
    assert after(told, (CAN_ERR_CRTL, data(CAN_ERR_CRTL_RX_WARNING))).rx_errors == 6
    assert after(told, (CAN_ERR_CRTL | CAN_ERR_CNT, data())) == HEALTHY


def test_other_classes_say_nothing_of_the_controllers_state():
    for classes in [CAN_ERR_TX_TIMEOUT, CAN_ERR_LOSTARB, CAN_ERR_PROT, CAN_ERR_ACK, CAN_ERR_BUSERROR]:
        # Their data bytes mean other things: byte 1 of none of them is the controller's.
        assert after((classes, data(CAN_ERR_CRTL_TX_PASSIVE))) == HEALTHY, classes
        assert not lost_frames(classes, data(CAN_ERR_CRTL_RX_OVERFLOW)), classes


def test_overflow_of_the_controller_is_a_loss():
    assert lost_frames(CAN_ERR_CRTL, data(CAN_ERR_CRTL_RX_OVERFLOW))
    assert not lost_frames(CAN_ERR_CRTL, data(CAN_ERR_CRTL_TX_OVERFLOW))


@given(st.integers(0, 0x1FFFFFFF), st.binary(max_size=64))
def test_any_frame_leaves_a_sound_health(classes, content):
    health = health_after(HEALTHY, classes, content)
    assert 0 <= health.tx_errors <= 255
    assert 0 <= health.rx_errors <= 255
    assert health.bus_off in (0, 1)
    if len(content) != 8:
        assert health == HEALTHY
        assert not lost_frames(classes, content)
