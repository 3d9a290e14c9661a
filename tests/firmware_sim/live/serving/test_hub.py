"""What a viewer gets: every period, the newest of the rest, however it reads."""

from hypothesis import given
from hypothesis import strategies as st

from firmware_sim.live.loop.messages import KEPT_PERIODS, LiveMessage
from firmware_sim.live.serving.supervisor import MOST_ROWS, STREAMS, Hub, Viewer
from tests.examples import examples
from tests.firmware_sim.live.serving.fake_session import hello, periods

NOW: list[LiveMessage] = [{"type": "now", "k": k} for k in range(3)]


def rows_of(message: LiveMessage | bytes | None) -> list[float]:
    assert not isinstance(message, bytes)
    return [] if message is None else list(message["columns"]["k"])


@given(st.lists(st.integers(0, 3), max_size=30))
@examples(30)
def test_no_period_is_missed_or_doubled(steps: list[int]):
    hub = Hub()
    hub.put([hello()])
    viewer, given_so_far, seen = Viewer(hub), 0, list[float]()
    viewer.take("hello")
    for new in [*steps, 0]:
        if new:
            hub.put([periods(*range(given_so_far, given_so_far + new))])
            given_so_far += new
        else:
            seen += rows_of(viewer.take("periods"))
    assert seen == list(range(given_so_far))


def test_a_viewer_who_is_late_gets_what_is_kept_in_parts_and_of_the_rest_the_newest_once():
    hub = Hub()
    hub.put([hello(), periods(*range(KEPT_PERIODS + 2)), NOW[1], b"first", NOW[2], b"second"])
    for viewer in (Viewer(hub), Viewer(hub)):
        for begin in range(2, KEPT_PERIODS, MOST_ROWS):
            assert rows_of(viewer.take("periods")) == list(range(begin, begin + MOST_ROWS))
        assert (viewer.take("now"), viewer.take("picture")) == (NOW[2], b"second")
        assert {viewer.take(stream) for stream in ("periods", "now", "picture")} == {None}


def test_a_new_run_begins_with_nothing_of_the_old_one():
    hub = Hub()
    hub.put([hello(), periods(1, 2), NOW[2], b"old"])
    late, early = Viewer(hub), Viewer(hub)
    early.take("hello")
    hub.put([hello(run=2), periods(0, run=2), NOW[0]])
    taken = {stream: message for stream in STREAMS if (message := late.take(stream)) is not None}
    assert taken == {"hello": hello(run=2), "periods": periods(0, run=2), "now": NOW[0]}
    # It may begin between two looks at the streams: with its `hello` a page begins again.
    for stream in ("periods", "now", "hello", "periods", "now"):
        assert early.take(stream) == taken[stream], stream
