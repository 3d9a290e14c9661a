"""Faults of single frames: lost, late, copied or reordered, and how the stream recovers; then wrong data on the wire,
behind the end-to-end protection and ahead of it, and a node that is stuck.
"""

from collections import Counter
from dataclasses import replace
from itertools import groupby, product
from math import sqrt
from typing import Any, Literal

from can_bridge.bus.faults.frame_faults import BurstLoss, Delay, Drop, Duplicate, FlipBits, Reorder, StuckAt, WireErrors
from can_bridge.e2e.profiles import PROFILE_5, E2eSender, SenderState, profile_of, protected_frame
from can_bridge.wire.frame import Frame
from can_bridge.wire.frame_bits import sent_bits, worst_case_ns
from can_bridge.wire.message_specs import PRESSURE, PRESSURE_SECURED, SPECS
from contract.errors import BusError
from tests.can_bridge.bus.faults.links import PERIOD_NS, PERIOD_S, number_of, numbered, numbers, simulated_link
from tests.refused import refused

MS = 10**6


def test_everything_named_is_lost_in_the_span_and_nothing_else():
    span: Any = {"probability": 1.0, "start_s": 10 * PERIOD_S, "end_s": 15 * PERIOD_S, "frame_ids": (0x120, 0x140)}
    for at in ("send", "receive"):
        link = simulated_link()
        faulty = link.wrapped(link.one if at == "send" else link.other, Drop(at=at, **span))
        sender, receiver = (faulty, link.other) if at == "send" else (link.one, faulty)
        received = [frame for frames in link.stream(sender, receiver, 30, frame_ids=(0x120, 0x130)) for frame in frames]
        assert numbers([[one for one in received if one.frame_id == 0x120]]) == [*range(10), *range(15, 30)], at
        assert (len(received), faulty.injectors[0].acted) == (25 + 30, 5), at
        # Who sends faultily is heard so by all; who receives faultily is alone with it.
        assert len(link.listener.receive_all()) == (55 if at == "send" else 60), at


def test_losses_and_bursts_have_the_stated_share_and_length():
    for loss, mean_burst in ((0.3, 1 / 0.7), (0.1, 4.0), (0.02, 1.0), (0.8, 10.0)):
        # Independent losses, the first, are bursts, too.
        fault = Drop(probability=loss) if loss == 0.3 else BurstLoss(loss=loss, mean_burst=mean_burst)
        link = simulated_link()
        n = 1000
        faulty = link.wrapped(link.one, fault)
        gone = [not frames for frames in link.stream(faulty, link.other, n)]
        assert faulty.injectors[0].acted == sum(gone)
        to_good = 1 / mean_burst
        correlation = 1 - to_good - to_good * loss / (1 - loss)
        # The variance of a sum over a two-state Markov chain, and of a geometric length; five standard deviations.
        spread = sqrt(loss * (1 - loss) / n * (1 + correlation) / (1 - correlation))
        assert abs(sum(gone) / n - loss) < 5 * spread, (loss, mean_burst)
        bursts = [len(list(group)) for is_gone, group in groupby(gone) if is_gone]
        assert len(bursts) > 12, (loss, mean_burst)
        length_spread = mean_burst * sqrt((1 - to_good) / len(bursts))
        assert abs(sum(bursts) / len(bursts) - mean_burst) <= 5 * length_spread, (loss, mean_burst)


def test_a_delay_counts_from_the_arrival_and_not_from_the_look(link):
    """A frame takes less than half a ms; it is looked for every ms, or first when its delay has passed."""
    faulty = link.wrapped(link.other, Delay(delay_s=0.0125))
    for number in range(3):
        begin_ms = link.now_ns // MS
        link.one.send(numbered(number, now_ns=link.now_ns))
        while not (frames := faulty.receive_all()):
            link.advance(MS)
        assert ([number_of(frame) for frame in frames], link.now_ns // MS - begin_ms) == ([number], 13)
    assert faulty.injectors[0].acted == 3
    link.one.send(numbered(7))
    link.advance()
    (late,) = faulty.receive_all()
    frame_ns = worst_case_ns(numbered(7), nominal_bitrate=500_000, data_bitrate=2_000_000)
    assert 0 <= late.timestamp_ns - 12.5 * MS - (link.now_ns - PERIOD_NS) <= frame_ns
    # A queue behind the stamp does not show in it.
    unseen = link.wrapped(link.other, Delay(delay_s=0.0125, restamp=False))
    assert link.stream(link.one, unseen, 1)[0] == link.listener.receive_all()[-1:]


def test_the_queue_empties_when_the_delay_ends(link):
    """Frames 6 to 9 come two periods late; 10 and 11 are not delayed themselves but stand in the queue behind 9."""
    faulty = link.wrapped(link.other, Delay(delay_s=2.5 * PERIOD_S, start_s=5.5 * PERIOD_S, end_s=9.5 * PERIOD_S))
    received = link.stream(link.one, faulty, 20)
    assert [len(frames) for frames in received] == [*[1] * 6, 0, 0, 1, 1, 1, 3, *[1] * 8]
    assert numbers(received) == list(range(20))
    assert faulty.injectors[0].acted == 6


def test_copies_follow_their_frame():
    for copies in [1, 3]:
        link = simulated_link()
        fault = Duplicate(copies=copies, at="receive", start_s=9.5 * PERIOD_S, end_s=29.5 * PERIOD_S)
        received = link.stream(link.one, link.wrapped(link.other, fault), 50)
        expected = [1 + copies * (10 <= step < 30) for step in range(50)]
        assert numbers(received) == [step for step in range(50) for _ in range(expected[step])], copies


def test_windows_come_whole_and_in_all_orders_equally_often():
    for window in [2, 3, 5]:
        link = simulated_link()
        faulty = link.wrapped(link.other, Reorder(window=window))
        periods = 900 if window == 3 else 60
        received = link.stream(link.one, faulty, periods)
        sizes = [0 if (k + 1) % window else window for k in range(periods)]
        assert [len(frames) for frames in received] == sizes, window
        flat = numbers(received)
        assert sorted(flat) == list(range(periods)), window
        assert max(abs(place - number) for place, number in enumerate(flat)) == window - 1, window
        moved = sum(place != number for place, number in enumerate(flat))
        assert faulty.injectors[0].acted == moved > 10, window
        if window == 3:
            orders = Counter(tuple(n % 3 for n in flat[k : k + 3]) for k in range(0, periods, 3))
            # Six orders of expectation 50, variance 300 * 1/6 * 5/6: within five standard deviations.
            assert len(orders) == 6 and max(abs(n - 50) for n in orders.values()) < 5 * (300 * 5 / 36) ** 0.5


def test_what_is_kept_comes_when_the_span_ends(link):
    faulty = link.wrapped(link.other, Reorder(window=10, end_s=5.5 * PERIOD_S))
    received = link.stream(link.one, faulty, 8)
    assert [len(frames) for frames in received] == [0, 0, 0, 0, 0, 6, 1, 1]
    assert sorted(numbers(received)) == list(range(8))
    assert number_of(received[5][-1]) == 5  # the first after the span is not shuffled with them


FRAME = Frame(frame_id=0x555, data=bytes([0x55] * 8), is_fd=False)
BITS = sum(sent_bits(FRAME).total) - 3


def test_so_many_different_bits_flip_behind_the_protection_in_the_span_on_either_side():
    sides: tuple[Literal["send", "receive"], ...] = ("send", "receive")
    for bits, at in product((1, 2, 3, 64), sides):
        link = simulated_link()
        fault = FlipBits(bits=bits, at=at, start_s=2.5 * PERIOD_S, end_s=6.5 * PERIOD_S)
        faulty = link.wrapped(link.one if at == "send" else link.other, fault)
        sender, receiver = (faulty, link.other) if at == "send" else (link.one, faulty)
        received = link.stream(sender, receiver, 10)
        flipped = [(number_of(frames[0]) ^ number).bit_count() for number, frames in enumerate(received)]
        assert flipped == [0] * 3 + [bits] * 4 + [0] * 3, (bits, at)


def test_every_message_of_ours_can_be_wrong_and_protected():
    for spec in (one for one in SPECS if not one.is_secured):
        profile = profile_of(spec)
        # The header's bits are laid out by the standard: 12 of profile 2, the CRC-8 first; 24 of profile 5.
        header = 0xFFF if spec.profile == 2 else 0xFFFFFF
        for bits in (1, 7, 8 * spec.protected - header.bit_length()):
            right = protected_frame(SenderState(counter=5), bytes(range(spec.protected)), spec=spec, now_ns=0)
            link = simulated_link()
            link.wrapped(link.one, FlipBits(bits=bits, before_crc=True)).send(right)
            link.advance()
            (wrong,) = link.other.receive_all()
            assert profile.check(wrong.data, data_id=spec.data_id), spec
            assert profile.counter_of(wrong.data) == 5, spec
            differ = int.from_bytes(right.data, "little") ^ int.from_bytes(wrong.data, "little")
            assert (differ & ~header).bit_count() == bits, (spec, bits)


def test_ahead_of_the_protection_others_pass_and_what_would_need_the_key_is_refused():
    for fault in (FlipBits(before_crc=True), StuckAt(counter_runs=True)):
        link = simulated_link()
        faulty = link.wrapped(link.one, fault)
        for number, frame_id in ((1, 0x7E0), (2, 0x7E0), (3, PRESSURE.frame_id)):
            faulty.send(numbered(number, frame_id=frame_id))
            link.advance()
        assert [number_of(frame) for frame in link.other.receive_all()] == [1, 2, 3], fault
        assert faulty.injectors[0].acted == 0, fault
        frame = Frame(frame_id=PRESSURE_SECURED.frame_id, data=bytes(PRESSURE_SECURED.length))
        with refused(BusError, r"PressureSecured is authenticated: .* needs the key"):
            faulty.send(frame)


def test_a_frozen_node_sends_the_first_frame_of_the_span_or_its_message_with_a_counter_that_runs():
    for runs in (False, True):
        link = simulated_link()
        fault = StuckAt(counter_runs=runs, start_s=2.5 * PERIOD_S, end_s=6.5 * PERIOD_S)
        faulty, sender = link.wrapped(link.one, fault), E2eSender(PRESSURE)
        sent, received = [], []
        for step in range(10):
            sent.append(sender.frame(bytes([step]) * PRESSURE.protected, now_ns=link.now_ns).data)
            faulty.send(replace(FRAME, frame_id=PRESSURE.frame_id, data=sent[-1], is_fd=True))
            link.advance()
            received += [frame.data for frame in link.other.receive_all()]
        frozen = [3 if 3 <= step <= 6 else step for step in range(10)]
        if not runs:
            assert received == [sent[step] for step in frozen]
            continue
        assert [data[3:] for data in received] == [sent[step][3:] for step in frozen]
        assert all(PROFILE_5.check(data, data_id=PRESSURE.data_id) for data in received)
        assert [data[2] for data in received] == list(range(10))


def test_frames_are_hit_as_often_as_independent_bits_make_them():
    for rate in [1e-4, 1e-2, 0.5]:
        hook = WireErrors(bit_error_rate=rate).hook(1)
        n = 2_000
        places = [place for _ in range(n) if (place := hook(FRAME, "any", 0)) is not None]
        hit = 1 - (1 - rate) ** BITS
        # Five standard deviations of a binomial number.
        assert abs(len(places) - n * hit) < 5 * (n * hit * (1 - hit)) ** 0.5 + 1e-9, rate
        assert 0 <= min(places) <= max(places) < BITS, rate
        # Place k is first with (1 - rate)^k rate: the mean over a frame that is hit, by summation.
        law = [(1 - rate) ** k * rate / hit for k in range(BITS)]
        mean = sum(k * p for k, p in enumerate(law))
        spread = sum((k - mean) ** 2 * p for k, p in enumerate(law)) ** 0.5
        assert abs(sum(places) / len(places) - mean) < 5 * spread / len(places) ** 0.5, rate


def test_only_the_named_nodes_and_frames_are_hit_in_the_span():
    hook = WireErrors(bit_error_rate=1.0, nodes=("ecu",), frame_ids=(0x555,), start_s=1.0, end_s=2.0).hook(1)
    hit = [hook(FRAME, "ecu", at) for at in (999_999_999, 10**9, 2 * 10**9 - 1, 2 * 10**9)]
    assert hit == [None, 0, 0, None]
    assert hook(FRAME, "vehicle", 10**9) is None
    assert hook(Frame(frame_id=0x120, data=b""), "ecu", 10**9) is None
