"""Lost frames: how many, how many in a row, which, and that it ends."""

from itertools import groupby
from math import sqrt

import pytest

from can_bridge.bus.faults.loss import BurstLoss, Drop
from can_bridge.e2e.receiver import StreamState
from contract.errors import ConfigError
from tests.can_bridge.bus.faults.links import PERIOD_S, number_of


def lost(received) -> list[bool]:
    """By period."""
    return [not frames for frames in received]


def numbers(received) -> list[int]:
    return [number_of(frame) for frames in received for frame in frames]


@pytest.mark.parametrize("side", ["send", "receive"])
def test_everything_is_lost_in_the_span_and_nothing_outside_it(link, side):
    fault = Drop(probability=1.0, at=side, start_s=10 * PERIOD_S, end_s=15 * PERIOD_S)
    faulty = link.wrapped(link.one if side == "send" else link.other, fault)
    ends = (faulty, link.other) if side == "send" else (link.one, faulty)
    received = numbers(link.stream(*ends, 30))
    assert received == [*range(10), *range(15, 30)]
    assert faulty.injectors[0].acted == 5
    # Who sends faultily is heard so by all; who receives faultily is alone with it.
    assert len(link.listener.receive_all()) == (25 if side == "send" else 30)


def test_as_many_are_lost_as_the_probability_says(simulated):
    n, p = 4000, 0.3
    faulty = simulated.wrapped(simulated.one, Drop(probability=p))
    received = numbers(simulated.stream(faulty, simulated.other, n))
    # Five standard deviations of a binomial number.
    assert abs(n - len(received) - n * p) < 5 * sqrt(n * p * (1 - p))
    assert faulty.injectors[0].acted == n - len(received)
    assert received == sorted(set(received))


@pytest.mark.parametrize(("loss", "mean_burst"), [(0.1, 4.0), (0.5, 3.0), (0.02, 1.0), (0.8, 10.0)])
def test_bursts_have_the_stated_share_and_length(simulated, loss, mean_burst):
    n = 6000
    faulty = simulated.wrapped(simulated.one, BurstLoss(loss=loss, mean_burst=mean_burst))
    gone = lost(simulated.stream(faulty, simulated.other, n))
    to_good = 1 / mean_burst
    correlation = 1 - to_good - to_good * loss / (1 - loss)
    # The variance of a sum over a two-state Markov chain, and of a geometric length; five standard deviations.
    spread = sqrt(loss * (1 - loss) / n * (1 + correlation) / (1 - correlation))
    assert abs(sum(gone) / n - loss) < 5 * spread
    bursts = [len(list(group)) for is_gone, group in groupby(gone) if is_gone]
    assert len(bursts) > 50
    assert abs(sum(bursts) / len(bursts) - mean_burst) <= 5 * mean_burst * sqrt((1 - to_good) / len(bursts))


def test_bursts_of_independent_losses_are_independent_losses():
    """Independent losses with probability q last 1 / (1 - q) frames on average: then the state does not matter."""
    for q in (0.1, 0.5, 0.9):
        fault = BurstLoss(loss=q, mean_burst=1 / (1 - q))
        assert (fault.to_bad, 1 - fault.to_good) == pytest.approx((q, q))


@pytest.mark.parametrize("fault", [Drop(probability=0.3), BurstLoss(loss=0.3, mean_burst=2.0)])
def test_the_seed_decides_which(link_of, fault):
    def run(seed):
        link = link_of()
        return numbers(link.stream(link.wrapped(link.one, fault, seed=seed), link.other, 200))

    assert run(1) == run(1)
    assert len({tuple(run(seed)) for seed in range(5)}) == 5


@pytest.mark.parametrize(
    "fault",
    [
        Drop(probability=1.0, start_s=20 * PERIOD_S, end_s=30 * PERIOD_S),
        BurstLoss(loss=0.75, mean_burst=10.0, start_s=20 * PERIOD_S, end_s=60 * PERIOD_S),
    ],
)
def test_the_stream_is_lost_and_then_trusted_again(link, fault):
    faulty = link.wrapped(link.one, fault)
    streams = [reception.stream for reception in link.protected(faulty, link.other, 80)]
    begin, end = round(fault.start_s / PERIOD_S), round(fault.end_s / PERIOD_S)
    assert set(streams[2:begin]) == {StreamState.VALID}
    assert StreamState.INVALID in streams[begin:end]
    # The jump of the counter costs the first frame, two good ones make the stream valid again.
    assert set(streams[end + 2 :]) == {StreamState.VALID}


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Drop(probability=1.5), r"drop\.probability = 1\.5: must be in \[0, 1\]"),
        (lambda: Drop(probability=0.1, start_s=2.0, end_s=1.0), r"drop\.end_s = 1\.0: must be start_s = 2\.0 or later"),
        (lambda: BurstLoss(loss=0.9, mean_burst=2.0), r"burst_loss\.loss = 0\.9: must be at most 0\.666667"),
        (lambda: BurstLoss(loss=0.1, mean_burst=0.5), r"burst_loss\.mean_burst = 0\.5: must be at least 1"),
        (lambda: Drop(probability=0.1, at="both"), r"drop\.at = 'both': must be 'send' or 'receive'"),  # type: ignore[arg-type]
    ],
)
def test_parameters_out_of_bounds_are_named(make, message):
    with pytest.raises(ConfigError, match=message):
        make()
