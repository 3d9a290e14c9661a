"""A controller that says when its latest control step began and ended: `Ecu.step` itself knows no clock."""

from collections.abc import Callable

from contract.arrays import Array
from contract.controller.interface import Controller, ControlStep


class TimedController:
    """Wraps another one.

    Attributes:
        began_ns, ended_ns: of the latest control step, whether it had an answer or not; 0 after `forget`.
    """

    def __init__(self, controller: Controller, now_ns: Callable[[], int]) -> None:
        self._controller = controller
        self._now_ns = now_ns
        self.forget()

    def forget(self) -> None:
        """Before a period in which there may be no control step."""
        self.began_ns = self.ended_ns = 0

    def control_step(self, window: Array, plan: Array, free: Array, weights: Array | None = None) -> ControlStep:
        """The other's."""
        self.began_ns = self._now_ns()
        try:
            return self._controller.control_step(window, plan, free, weights)
        finally:
            self.ended_ns = self._now_ns()
