"""udsoncan's connection to an ECU on the bench: while its client waits for an answer, virtual time passes."""

import logging
from typing import Any

from udsoncan.connections import BaseConnection
from udsoncan.exceptions import TimeoutException

from firmware_sim.bench.flashing.flash_bench import FlashBench


class BenchConnection(BaseConnection):
    """Open from `open` to `close`."""

    def __init__(self, bench: FlashBench) -> None:
        super().__init__("bench")
        for name in ("UdsClient", "Connection"):
            # Without a handler Python prints their warnings to stderr.
            logging.getLogger(name).addHandler(logging.NullHandler())
        self._bench = bench
        self._is_open = False

    def open(self) -> "BenchConnection":
        """Nothing is opened: the bench is there."""
        self._is_open = True
        return self

    def close(self) -> None:
        """Take no more requests."""
        self._is_open = False

    def is_open(self) -> bool:
        """Whether requests are taken."""
        return self._is_open

    def empty_rxqueue(self) -> None:
        """Drop late answers to earlier requests."""
        self._bench.forget_answers()

    def specific_send(self, payload: bytes, timeout: float | None = None) -> None:
        """Hand a request over."""
        self._bench.ask(payload)

    def specific_wait_frame(self, timeout: float | None = None) -> Any:
        """The next answer; raises TimeoutException if none comes in so long."""
        answer = self._bench.answer(2.0 if timeout is None else timeout)
        if answer is None:
            raise TimeoutException(f"no answer within {timeout} s of virtual time")  # type: ignore[no-untyped-call]
        return answer
