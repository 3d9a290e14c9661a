"""What every outcome of an attempt has in common, whoever sends and whatever is seen wrong."""

from hypothesis import given
from hypothesis import strategies as st

from can_bridge.bus.simulated.attempt import Sender, Verdict, resolve
from can_bridge.wire.frame import Frame
from can_bridge.wire.frame_bits import sent_bits

POSITIONS = st.integers(0, 200)


@st.composite
def attempts(draw):
    """Senders of one identifier, receivers that are error-passive or not, and errors."""
    frame_id, is_fd = draw(st.integers(0, 0x7FF)), draw(st.booleans())
    senders = []
    for k in range(draw(st.integers(1, 3))):
        frame = Frame(frame_id=frame_id, data=draw(st.sampled_from([b"\x00", b"\x01", b"\x55\x55"])), is_fd=is_fd)
        passive = draw(st.booleans())
        senders.append(Sender(f"sender {k}", frame, sent_bits(frame), passive))
    receivers = {f"receiver {k}": draw(st.booleans()) for k in range(draw(st.integers(0, 3)))}
    misheard = {name: draw(POSITIONS) for name in receivers if draw(st.booleans())}
    return senders, receivers, misheard, draw(st.none() | POSITIONS)


@given(attempt=attempts())
def test_every_node_gets_a_verdict_and_a_frame_goes_through_or_does_not(attempt):
    senders, receivers, misheard, disturbed = attempt
    outcome = resolve(senders, receivers, misheard=misheard, disturbed=disturbed)
    assert set(outcome.verdicts) == {sender.node for sender in senders} | set(receivers)
    heard = {node for node, verdict in outcome.verdicts.items() if verdict is Verdict.HEARD}
    sent = {node for node, verdict in outcome.verdicts.items() if verdict is Verdict.SENT}
    assert heard <= set(receivers) - set(misheard)
    if outcome.frame is None:
        assert not heard
        assert not sent
    if sent:
        # All heard it but those that misheard it and are error-passive, so that they could not say so.
        assert outcome.frame is not None
        assert set(receivers) - heard == set(misheard)
        assert all(receivers[node] for node in misheard)
        assert outcome.rest == 3
    else:
        assert outcome.rest >= 6 + 8 + 3
    unacknowledged = Verdict.UNACKNOWLEDGED in outcome.verdicts.values()
    assert not (unacknowledged and heard)
    if not receivers:
        assert not sent
    longest = max(sum(sender.bits.total) for sender in senders)
    assert 0 < sum(outcome.used) <= longest - 3
    # All who sent to the end sent the same.
    contents = {sender.frame.data for sender in senders if sender.node in sent}
    assert len(contents) <= 1


@given(attempt=attempts())
def test_without_errors_one_sender_is_heard_by_all_there_are(attempt):
    senders, receivers, _, _ = attempt
    outcome = resolve(senders[:1], receivers, misheard={}, disturbed=None)
    if receivers:
        assert outcome.verdicts == {senders[0].node: Verdict.SENT, **dict.fromkeys(receivers, Verdict.HEARD)}
        assert outcome.used == (senders[0].bits.total[0] - 3, senders[0].bits.total[1])
    else:
        assert outcome.verdicts == {senders[0].node: Verdict.UNACKNOWLEDGED}
