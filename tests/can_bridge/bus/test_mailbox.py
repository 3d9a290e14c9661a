from hypothesis import given
from hypothesis import strategies as st

from can_bridge.bus.mailbox import Mailbox


@given(st.lists(st.none() | st.integers()))
def test_latest_value_once_and_every_lost_one_counted(actions):
    """None takes, a number puts; an obvious model runs with the mailbox."""
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
