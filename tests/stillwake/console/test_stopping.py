"""A command that is stopped: one line, the status that shells expect, and no stop that gets lost."""

import signal
import sys
import weakref
from collections.abc import Iterator
from contextlib import suppress

import pytest

from stillwake.console import stopping
from stillwake.console.endings import status_of
from stillwake.console.progress import progress

STATUSES = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGHUP: 129}


@pytest.fixture(autouse=True)
def signals() -> Iterator[None]:
    """Signals end the test's command as they end every command, and afterwards do again what they did."""
    before, hook = {number: signal.getsignal(number) for number in STATUSES}, sys.unraisablehook
    signal.signal(signal.SIGINT, signal.default_int_handler)
    stopping.ends_like_ctrl_c()
    yield
    stopping.outcome()
    sys.unraisablehook = hook
    for number, handler in before.items():
        signal.signal(number, handler)


def test_a_stopped_command_clears_away_and_prints_how_to_go_on(capsys):
    for number, status in STATUSES.items():
        cleared: list[bool] = []

        def wait(number: int = number, cleared: list[bool] = cleared) -> None:
            with stopping.go_on_with(lambda: "the same command continues"):
                try:
                    signal.raise_signal(number)
                finally:
                    cleared.append(True)

        assert status_of(wait) == status
        assert cleared
        assert capsys.readouterr().err == "stopped; the same command continues\n"
        # The advice is given once, and a second SIGTERM would kill.
        assert stopping.outcome() == (130, "stopped")
    assert signal.getsignal(signal.SIGTERM) is signal.getsignal(signal.SIGHUP) is signal.SIG_DFL


def test_under_nohup_a_closed_terminal_stops_nothing() -> None:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    stopping.ends_like_ctrl_c()
    with stopping.until_stopped() as is_stopped:
        signal.raise_signal(signal.SIGHUP)
        assert not is_stopped()
    assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN


def test_work_that_a_stop_ends_well_is_asked_once_and_stopped_by_the_second() -> None:
    theirs = signal.getsignal(signal.SIGINT)
    for number, status in STATUSES.items():
        stopping.ends_like_ctrl_c()
        with stopping.until_stopped() as is_stopped:
            assert not is_stopped()
            signal.raise_signal(number)
            assert is_stopped()
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(number)
        assert signal.getsignal(signal.SIGINT) is theirs
        # What its command raises when the work was not done has the status of the signal.
        assert stopping.outcome()[0] == status


@pytest.mark.parametrize("where", ["compiled code", "a callback", "before work that a stop ends well"])
def test_a_stop_that_got_lost_still_stops(capsys, where):
    went_on = []

    def lose() -> None:
        if where == "a callback":
            watched: weakref.ref[set[int]] = weakref.ref(set(), lambda _: signal.raise_signal(signal.SIGTERM))
            assert watched() is None
        else:
            with suppress(BaseException):  # as compiled code may do
                signal.raise_signal(signal.SIGTERM)
        if where.startswith("before"):
            with stopping.until_stopped():
                went_on.append(True)
        with progress("steps") as report:
            report("work", 0, 1)
            went_on.append(True)

    assert status_of(lose) == 143
    assert not went_on
    assert tuple(capsys.readouterr()) == ("", "stopped\n")
