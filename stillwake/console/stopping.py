"""How a command ends on Ctrl-C or SIGTERM: alike, with what is needed to go on in one line."""

import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import current_thread, main_thread
from typing import Any, Final

INTERRUPTED: Final = 130
"""Exit status after Ctrl-C, as shells have it."""
TERMINATED: Final = 143
"""Exit status after SIGTERM, as shells have it."""

_asked: list[str] = []
"""Signals that came, by name."""
_advice: list[str] = []
_is_left_to_work = False
"""Within `until_stopped`, which nothing interrupts."""
_hook_before: Callable[["sys.UnraisableHookArgs"], object] = sys.unraisablehook
"""The hook that took a callback's exception before ours."""


def ends_like_ctrl_c() -> None:
    """Let SIGTERM raise what Ctrl-C raises, so that everything half-written is cleared away; a second one kills.

    Python sees a signal between two of its own steps: compiled code and an import end first. Some of that takes the
    exception for an error of its own and goes on; `until_stopped` and `still_wanted` then know. A callback, which can
    raise nothing, would print it. Outside the main thread, which alone may take signals, nothing is changed.
    """
    if current_thread() is not main_thread():
        return
    _asked.clear()
    _advice.clear()

    def stop(number: int, _frame: Any) -> None:
        _asked.append(signal.Signals(number).name)
        signal.signal(number, signal.SIG_DFL)
        raise KeyboardInterrupt

    signal.signal(signal.SIGTERM, stop)
    global _hook_before
    if sys.unraisablehook is not _report_lost:
        _hook_before, sys.unraisablehook = sys.unraisablehook, _report_lost


def _report_lost(lost: "sys.UnraisableHookArgs") -> None:
    if not (_asked and lost.exc_type is KeyboardInterrupt):
        _hook_before(lost)


@contextmanager
def until_stopped() -> Iterator[Callable[[], bool]]:
    """Work that a stop ends well: yields whether Ctrl-C or SIGTERM came, as a function. A second one stops at once.

    Nothing is interrupted, so that whatever is being written is written to its end. Outside the main thread, which
    alone may take signals, nothing ever stops it. Raises KeyboardInterrupt if a stop came before, and was lost.
    """
    if current_thread() is not main_thread():
        yield lambda: False
        return
    still_wanted()
    came: list[int] = []
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}

    def stop(number: int, _frame: Any) -> None:
        came.append(number)
        # For the exit status, if the work was not done and its command raises KeyboardInterrupt.
        _asked.append(signal.Signals(number).name)
        signal.signal(number, before[signal.Signals(number)])

    global _is_left_to_work
    for number in before:
        signal.signal(number, stop)
    _is_left_to_work = True
    try:
        yield lambda: bool(came)
    finally:
        _is_left_to_work = False
        for number, handler in before.items():
            signal.signal(number, handler)


def still_wanted() -> None:
    """Raises KeyboardInterrupt in the main thread if SIGTERM came and what it raised was lost on its way."""
    if _asked and not _is_left_to_work and current_thread() is main_thread():
        raise KeyboardInterrupt


@contextmanager
def go_on_with(line: str) -> Iterator[None]:
    """Work that can be continued: when it is stopped, `line` describes how."""
    try:
        yield
    except KeyboardInterrupt:
        _advice.append(line)
        raise


def outcome() -> tuple[int, str]:
    """Exit status and line of a command that was stopped."""
    status = TERMINATED if "SIGTERM" in _asked else INTERRUPTED
    line = "; ".join(["stopped", *_advice])
    _asked.clear()
    _advice.clear()
    return status, line
