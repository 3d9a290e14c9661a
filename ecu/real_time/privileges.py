"""The privileges that a process with deadlines requests from the system. A refused privilege is reported."""

import ctypes
import gc
import os
import resource
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, NamedTuple

PRIORITY: Final = 50
"""Priority under SCHED_FIFO, 1 to 99. It is above every ordinary process, and equal to the priority of most interrupt
threads in the kernel (50), so that the threads of the CAN driver still run."""
TIMER_SLACK_NS: Final = 1
"""Timer slack in ns. By default, Linux wakes ordinary processes up to 50 us late, to wake several of them together."""

_MCL_CURRENT, _MCL_FUTURE = 1, 2
_PR_SET_TIMERSLACK, _PR_GET_TIMERSLACK = 29, 30


class Privilege(NamedTuple):
    """A privilege; `refused_because` is empty if the process has it."""

    what: str
    refused_because: str = ""


@dataclass(frozen=True, kw_only=True)
class Wanted:
    """The requested privileges. `priority` is a SCHED_FIFO priority, 1 to 99, or 0 to stay an ordinary process."""

    priority: int = PRIORITY
    lock_memory: bool = True
    without_collector: bool = True


@contextmanager
def taken(wanted: Wanted) -> Iterator[list[Privilege]]:
    """Request privileges, yield the results, and give the privileges back at the end of the block. The priority applies
    to this thread and to the threads that it starts afterwards."""
    steps = (
        ("timer slack 1 ns", _timer_slack, True),
        ("no garbage collection", _no_collector, wanted.without_collector),
        ("memory locked", _lock_memory, wanted.lock_memory),
        (f"SCHED_FIFO {wanted.priority}", partial(_priority, wanted.priority), bool(wanted.priority)),
    )
    with ExitStack() as undo:
        yield [_attempt(what, ask, undo) for what, ask, is_wanted in steps if is_wanted]


def in_words(privileges: list[Privilege]) -> str:
    """Return one line: the granted privileges, and the refused privileges with the reasons."""
    granted = ", ".join(item.what for item in privileges if not item.refused_because) or "none"
    refused = ", ".join(f"{item.what} ({item.refused_because})" for item in privileges if item.refused_because)
    return f"{granted}; not granted: {refused}" if refused else granted


def stay_ordinary() -> None:
    """Give this thread an ordinary priority for long work, even if it was started with a real-time priority."""
    if hasattr(os, "sched_setscheduler"):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def step_back() -> None:
    """Give this thread the lowest real-time priority, if it was started with a real-time priority. With an ordinary
    priority, any process could interrupt it while it holds the interpreter's lock, and so delay the control loop."""
    if hasattr(os, "sched_getscheduler") and os.sched_getscheduler(0) == os.SCHED_FIFO:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))


def _attempt(what: str, ask: Callable[[ExitStack], None], undo: ExitStack) -> Privilege:
    try:
        ask(undo)
    except AttributeError:
        return Privilege(what, f"not on {sys.platform}")
    except (OSError, ValueError) as error:
        return Privilege(what, (getattr(error, "strerror", None) or str(error)).lower())
    return Privilege(what)


def _no_collector(undo: ExitStack) -> None:
    was_enabled, was_frozen = gc.isenabled(), gc.get_freeze_count() > 0
    gc.collect()
    gc.freeze()
    gc.disable()
    if not was_frozen:
        undo.callback(gc.unfreeze)
    if was_enabled:
        undo.callback(gc.enable)


def _priority(priority: int, undo: ExitStack) -> None:
    policy, before = os.sched_getscheduler(0), os.sched_getparam(0)
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    undo.callback(os.sched_setscheduler, 0, policy, before)


def _timer_slack(undo: ExitStack) -> None:
    before = _call("prctl", _PR_GET_TIMERSLACK, 0, 0, 0, 0)
    _call("prctl", _PR_SET_TIMERSLACK, TIMER_SLACK_NS, 0, 0, 0)
    undo.callback(_call, "prctl", _PR_SET_TIMERSLACK, before, 0, 0, 0)


def _lock_memory(undo: ExitStack) -> None:
    _call("mlockall", _MCL_CURRENT)
    undo.callback(_call, "munlockall")
    # If the locked memory is limited, later allocations are not locked, because they could exceed the limit and fail.
    if os.geteuid() == 0 or resource.getrlimit(resource.RLIMIT_MEMLOCK)[0] == resource.RLIM_INFINITY:
        _call("mlockall", _MCL_CURRENT | _MCL_FUTURE)


def _call(name: str, *arguments: int) -> int:
    """Call a function of the C library; raises OSError if it returns -1, AttributeError if it does not exist."""
    if sys.platform != "linux":
        raise AttributeError(name)
    function: Any = getattr(ctypes.CDLL(None, use_errno=True), name)
    answer: int = function(*(ctypes.c_ulong(value) if index else value for index, value in enumerate(arguments)))
    if answer == -1:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))
    return answer
