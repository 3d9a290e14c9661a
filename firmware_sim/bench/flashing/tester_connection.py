"""udsoncan's connection to an ECU on the bench: while its client waits for an answer, virtual time passes."""

from typing import Any

from udsoncan.exceptions import TimeoutException

from can_bridge.tester.direct_connection import DirectConnection
from firmware_sim.bench.flashing.flash_bench import FlashBench


class BenchConnection(DirectConnection):
    """The connection of a tester on the bench."""

    def __init__(self, bench: FlashBench) -> None:
        super().__init__()
        self._bench = bench

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
