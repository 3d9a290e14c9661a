"""The clock CLOCK_MONOTONIC, which cannot be set, and a sleep until an instant of this clock.

`time.sleep` takes a duration: if a process loses the processor between computing the duration and sleeping, it wakes
too late. `clock_nanosleep` takes the instant itself. Python has no such function, so this module calls the function of
the C library. If the library has no such function, the module sleeps for a duration.
"""

import ctypes
import errno
import sys
import time
from collections.abc import Callable
from typing import Any, Final

TIMER_ABSTIME: Final = 1
"""Flag of time.h: the time is an instant, not a duration."""
LONGEST_NAP_NS: Final = 100_000_000
"""Longest single sleep in ns if only a duration can be given; this limits the delay after a suspend of the computer."""


class _Timespec(ctypes.Structure):
    _fields_ = (("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long))


now_ns: Final = time.monotonic_ns
"""Function that returns the time of CLOCK_MONOTONIC in ns."""


def sleep_until(due_ns: int, *, spin_ns: int = 0) -> None:
    """Wait until `now_ns` reaches `due_ns`; return immediately if this time has passed. During the last `spin_ns` the
    process polls the clock, which is more precise than a wake-up, but the process's other threads have to wait."""
    until_ns = due_ns - spin_ns
    if until_ns > now_ns():
        _sleep(until_ns)
    while now_ns() < due_ns:
        pass


def _sleep_by_duration(until_ns: int) -> None:
    while (left := until_ns - now_ns()) > 0:
        time.sleep(min(left, LONGEST_NAP_NS) / 1e9)


def _absolute_sleep() -> Callable[[int], None]:
    if sys.platform != "linux":
        return _sleep_by_duration
    try:
        clock_nanosleep: Any = ctypes.CDLL(None).clock_nanosleep
    except (OSError, AttributeError):
        return _sleep_by_duration
    clock_nanosleep.argtypes = (ctypes.c_int, ctypes.c_int, ctypes.POINTER(_Timespec), ctypes.c_void_p)
    clock_nanosleep.restype = ctypes.c_int

    def sleep(until_ns: int) -> None:
        until = ctypes.byref(_Timespec(*divmod(until_ns, 1_000_000_000)))
        # A signal ends the sleep early, after Python's handler has run; the handler may have raised an exception.
        while (failed := clock_nanosleep(time.CLOCK_MONOTONIC, TIMER_ABSTIME, until, None)) == errno.EINTR:
            pass
        if failed:
            _sleep_by_duration(until_ns)

    return sleep


_sleep: Final = _absolute_sleep()
