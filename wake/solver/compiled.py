"""The compilation of the solver's inner loops by numba."""

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit

F = TypeVar("F", bound=Callable[..., Any])


def compiled(*fastmath: str) -> Callable[[F], F]:
    """Return a decorator that compiles a function, which then runs without Python's global interpreter lock. `fastmath`
    are LLVM's flags for floating-point operations.

    Compiled code is kept beside the function's file, or in the user's cache folder. If neither folder can be written,
    as in a read-only container without a home, each process compiles the function again.
    """

    def decorate(function: F) -> F:
        try:
            return cast("F", njit(cache=True, nogil=True, fastmath=set(fastmath))(function))
        except RuntimeError:  # numba found no folder for its cache
            return cast("F", njit(nogil=True, fastmath=set(fastmath))(function))

    return decorate
