"""The end of a command by Ctrl-C, SIGTERM or SIGHUP (the terminal is closed): the command stops, and a line
states how to continue."""

import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import current_thread, main_thread
from typing import Any, Final

INTERRUPTED: Final = 130
"""Exit status after Ctrl-C, as in shells."""
_STOPS: Final[dict[int, int]] = {
    signal.Signals[name]: status for name, status in (("SIGTERM", 143), ("SIGHUP", 129)) if hasattr(signal, name)
}
"""Exit status, as in shells, for each of the other signals that stop a command. Windows has no SIGHUP."""

_asked: list[int] = []
"""Signals that were received."""
_advice: list[str] = []
_is_left_to_work = False
"""Whether work in an `until_stopped` block is running. The first signal does not interrupt this work."""
_hook_before: Callable[["sys.UnraisableHookArgs"], object] = sys.unraisablehook
"""The hook for exceptions in callbacks that was in use before this module replaced it."""


def ends_like_ctrl_c() -> None:
    """Let SIGTERM and SIGHUP raise KeyboardInterrupt, as Ctrl-C does, so that incomplete files are removed; the same
    signal again kills the process. A signal that is ignored, as SIGHUP is under `nohup`, stays ignored.

    Python handles a signal only between two of its own steps, so compiled code or an import ends before the signal is
    handled. Some compiled code treats the KeyboardInterrupt as an error of its own and continues; `until_stopped` and
    `still_wanted` then raise KeyboardInterrupt again. A KeyboardInterrupt in a callback is lost too. Python would print
    it, but a hook prevents the printing. Only the main thread may handle signals; in another thread this function does
    nothing.
    """
    if current_thread() is not main_thread():
        return
    _asked.clear()
    _advice.clear()

    def stop(number: int, _frame: Any) -> None:
        _asked.append(number)
        signal.signal(number, signal.SIG_DFL)
        raise KeyboardInterrupt

    for number in _heeded():
        signal.signal(number, stop)
    global _hook_before
    if sys.unraisablehook is not _report_lost:
        _hook_before, sys.unraisablehook = sys.unraisablehook, _report_lost


def _heeded() -> list[int]:
    return [number for number in _STOPS if signal.getsignal(number) is not signal.SIG_IGN]


def _report_lost(lost: "sys.UnraisableHookArgs") -> None:
    if not (_asked and lost.exc_type is KeyboardInterrupt):
        _hook_before(lost)


@contextmanager
def until_stopped() -> Iterator[Callable[[], bool]]:
    """Yield a function that returns whether Ctrl-C, SIGTERM or SIGHUP was received. Work that calls this function can
    end by itself.

    The first signal does not interrupt the work, so that files are completed; a second signal interrupts the work. Only
    the main thread may handle signals; in another thread no signal stops the work. Raises KeyboardInterrupt if the
    exception of an earlier SIGTERM or SIGHUP was lost.
    """
    if current_thread() is not main_thread():
        yield lambda: False
        return
    still_wanted()
    came: list[int] = []
    before = {number: signal.getsignal(number) for number in [signal.SIGINT, *_heeded()]}

    def stop(number: int, _frame: Any) -> None:
        came.append(number)
        # A command with incomplete work raises KeyboardInterrupt later; its exit status then depends on this signal.
        _asked.append(number)
        signal.signal(number, before[number])

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
    """Raise KeyboardInterrupt in the main thread if the exception of an earlier SIGTERM or SIGHUP was lost."""
    if _asked and not _is_left_to_work and current_thread() is main_thread():
        raise KeyboardInterrupt


@contextmanager
def go_on_with(advice: Callable[[], str]) -> Iterator[None]:
    """Run work that can be continued. If the work is stopped, the command prints `advice()`, a text on how to continue,
    which may be empty."""
    try:
        yield
    except KeyboardInterrupt:
        _advice.extend(filter(None, [advice()]))
        raise


def outcome() -> tuple[int, str]:
    """Return the exit status of a command that was stopped, and the line to print."""
    status = next((_STOPS[number] for number in _asked if number in _STOPS), INTERRUPTED)
    line = "; ".join(["stopped", *_advice])
    _asked.clear()
    _advice.clear()
    return status, line
