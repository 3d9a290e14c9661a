"""Lost frames: how many, how many in a row, which, and that it ends."""

from itertools import groupby
from math import sqrt
from typing import Any

import pytest

from can_bridge.bus.faults.loss import BurstLoss, Drop
from tests.can_bridge.bus.faults.links import PERIOD_S, numbers, simulated_link


def test_everything_is_lost_in_the_span_and_nothing_outside_it():
    span: Any = {"probability": 1.0, "start_s": 10 * PERIOD_S, "end_s": 15 * PERIOD_S}
    for at in ("send", "receive"):
        link = simulated_link()
        faulty = link.wrapped(link.one if at == "send" else link.other, Drop(at=at, **span))
        sender, receiver = (faulty, link.other) if at == "send" else (link.one, faulty)
        assert numbers(link.stream(sender, receiver, 30)) == [*range(10), *range(15, 30)], at
        assert faulty.injectors[0].acted == 5, at
        # Who sends faultily is heard so by all; who receives faultily is alone with it.
        assert len(link.listener.receive_all()) == (25 if at == "send" else 30), at


def test_as_many_are_lost_as_the_probability_says(link):
    n, p = 4000, 0.3
    faulty = link.wrapped(link.one, Drop(probability=p))
    received = numbers(link.stream(faulty, link.other, n))
    # Five standard deviations of a binomial number.
    assert abs(n - len(received) - n * p) < 5 * sqrt(n * p * (1 - p))
    assert faulty.injectors[0].acted == n - len(received)
    assert received == sorted(set(received))


def test_bursts_have_the_stated_share_and_length():
    for loss, mean_burst in ((0.1, 4.0), (0.02, 1.0), (0.8, 10.0)):
        link = simulated_link()
        n = 3000
        faulty = link.wrapped(link.one, BurstLoss(loss=loss, mean_burst=mean_burst))
        gone = [not frames for frames in link.stream(faulty, link.other, n)]
        to_good = 1 / mean_burst
        correlation = 1 - to_good - to_good * loss / (1 - loss)
        # The variance of a sum over a two-state Markov chain, and of a geometric length; five standard deviations.
        spread = sqrt(loss * (1 - loss) / n * (1 + correlation) / (1 - correlation))
        assert abs(sum(gone) / n - loss) < 5 * spread, (loss, mean_burst)
        bursts = [len(list(group)) for is_gone, group in groupby(gone) if is_gone]
        assert len(bursts) > 25, (loss, mean_burst)
        length_spread = mean_burst * sqrt((1 - to_good) / len(bursts))
        assert abs(sum(bursts) / len(bursts) - mean_burst) <= 5 * length_spread, (loss, mean_burst)


def test_bursts_of_independent_losses_are_independent_losses():
    """Independent losses with probability q last 1 / (1 - q) frames on average: then the state does not matter."""
    for q in (0.1, 0.5, 0.9):
        fault = BurstLoss(loss=q, mean_burst=1 / (1 - q))
        assert (fault.to_bad, 1 - fault.to_good) == pytest.approx((q, q))
