"""A real process of a command that is stopped: one line, and the status that shells expect."""

import os
import signal
import subprocess
import sys
import threading

import pytest

from stillwake.console import stopping
from stillwake.console.own_rooms import HOME

# A command of two lines in place of a long one; shells start background jobs deaf to Ctrl-C, and a test may run in one.
WAITS = """
import signal, sys, time
signal.signal(signal.SIGINT, signal.default_int_handler)
from stillwake import __main__ as door
from stillwake.console.stopping import go_on_with

@door.app.command()
def wait(stubborn: bool = False) -> None:
    with go_on_with("the same command goes on"):
        try:
            print("waiting", flush=True)
            time.sleep(60.0)
        finally:
            print("clears away", flush=True)
            if stubborn:
                time.sleep(60.0)

door.main()
"""


def start(*arguments: str) -> subprocess.Popen[str]:
    process = subprocess.Popen(
        [sys.executable, "-c", WAITS, "wait", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(HOME)},
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "waiting\n"
    return process


@pytest.mark.processes
@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_stopped_command_clears_away_and_says_how_to_go_on(number, status):
    process = start()
    process.send_signal(number)
    out, err = process.communicate(timeout=60.0)
    assert (process.returncode, out, err) == (status, "clears away\n", "stopped; the same command goes on\n")


@pytest.mark.processes
def test_a_second_sigterm_kills():
    process = start("--stubborn")
    process.send_signal(signal.SIGTERM)
    assert process.stdout is not None
    assert process.stdout.readline() == "clears away\n"
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=60.0)
    assert process.returncode == -signal.SIGTERM


def test_another_thread_leaves_the_signals_alone():
    before, failed = signal.getsignal(signal.SIGTERM), []

    def run() -> None:
        try:
            stopping.ends_like_ctrl_c()
        except ValueError as error:
            failed.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    thread.join(10.0)
    assert not failed
    assert signal.getsignal(signal.SIGTERM) is before


def test_advice_is_given_once():
    with pytest.raises(KeyboardInterrupt), stopping.go_on_with("go on"):
        raise KeyboardInterrupt
    assert stopping.outcome() == (130, "stopped; go on")
    assert stopping.outcome() == (130, "stopped")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_work_that_a_stop_ends_well_is_told_once_and_stopped_by_the_second(number: signal.Signals) -> None:
    before = {one: signal.getsignal(one) for one in (signal.SIGINT, signal.SIGTERM)}
    try:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        stopping.ends_like_ctrl_c()
        theirs = {one: signal.getsignal(one) for one in before}
        with stopping.until_stopped() as is_stopped:
            assert not is_stopped()
            signal.raise_signal(number)
            assert is_stopped()
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(number)
        assert {one: signal.getsignal(one) for one in before} == theirs
        # What its command raises when the work was not done has the status of the signal.
        assert stopping.outcome()[0] == (143 if number is signal.SIGTERM else 130)
    finally:
        for one, handler in before.items():
            signal.signal(one, handler)


LOSES = """
from stillwake import __main__ as door
from stillwake.console.stopping import until_stopped
from stillwake.console.terminal import progress_bar
import signal, weakref

@door.app.command()
def lose(quietly: bool = False, in_a_callback: bool = False) -> None:
    if in_a_callback:
        watched = weakref.ref(set(), lambda _: signal.raise_signal(signal.SIGTERM))
    else:
        try:
            signal.raise_signal(signal.SIGTERM)
        except BaseException:
            pass  # as compiled code may do
    if quietly:
        with until_stopped():
            print("goes on")
    with progress_bar("steps") as bar:
        bar.update(bar.add_task("work", total=1, note=""), completed=0)
        print("goes on")

door.main()
"""


@pytest.mark.processes
@pytest.mark.parametrize("options", [(), ("--quietly",), ("--in-a-callback",)])
def test_a_stop_that_got_lost_still_stops(options):
    process = subprocess.run(
        [sys.executable, "-c", LOSES, "lose", *options],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": str(HOME)},
        timeout=60.0,
        check=False,
    )
    assert (process.returncode, process.stdout, process.stderr) == (143, "", "stopped\n")
