"""A mailbox for one value: a new one replaces the last, nothing queues up."""

from threading import Lock
from typing import Generic, TypeVar

T = TypeVar("T")


class Mailbox(Generic[T]):
    """Hands the latest value from one thread to another."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._value: T | None = None
        self._overwritten = 0

    def put(self, value: T) -> None:
        """Leave a value; one that was not taken is lost and counted."""
        with self._lock:
            if self._value is not None:
                self._overwritten += 1
            self._value = value

    def take(self) -> T | None:
        """The latest value, once; None if nothing came since the last take."""
        with self._lock:
            value, self._value = self._value, None
            return value

    @property
    def overwritten(self) -> int:
        """Values lost so far."""
        with self._lock:
            return self._overwritten
