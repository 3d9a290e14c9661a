from threading import Thread

from hypothesis import given
from hypothesis import strategies as st

from can_bridge.bus.mailbox import Mailbox


@given(st.lists(st.none() | st.integers()))
def test_latest_value_once_and_every_lost_one_counted(actions):
    """None takes, a number puts; an obvious model runs beside the mailbox."""
    mailbox: Mailbox[int] = Mailbox()
    waiting: list[int] = []
    lost = 0
    for action in actions:
        if action is None:
            assert mailbox.take() == (waiting.pop() if waiting else None)
        else:
            lost += len(waiting)
            waiting = [action]
            mailbox.put(action)
        assert mailbox.overwritten == lost


def test_no_value_vanishes_between_threads():
    mailbox: Mailbox[int] = Mailbox()
    values, taken = range(1, 2001), []

    def write() -> None:
        for value in values:
            mailbox.put(value)

    writer = Thread(target=write)
    writer.start()
    while writer.is_alive():
        if (value := mailbox.take()) is not None:
            taken.append(value)
    if (value := mailbox.take()) is not None:
        taken.append(value)
    writer.join()
    assert taken == sorted(set(taken))
    assert taken[-1] == values[-1]
    assert len(taken) + mailbox.overwritten == len(values)
