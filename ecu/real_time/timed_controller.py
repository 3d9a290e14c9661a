"""A controller that records when its latest control step began and ended: `Ecu.step` itself knows no clock."""

from collections.abc import Callable
from typing import Any

from contract.controller.interface import Controller, ControlStep


class PlanTimes:
    """When the latest control step of any of several controllers was made, each running in place of the one before.
    Both are 0 after `forget`."""

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Before a period in which there may be no control step."""
        self.began_ns = self.ended_ns = 0


class TimedController:
    """Wraps another one."""

    def __init__(self, controller: Controller, now_ns: Callable[[], int], times: PlanTimes | None = None) -> None:
        self._controller = controller
        self._now_ns = now_ns
        self.times = PlanTimes() if times is None else times

    def control_step(self, *given: Any, **named: Any) -> ControlStep:
        """The other's."""
        self.times.began_ns = self._now_ns()
        try:
            return self._controller.control_step(*given, **named)
        finally:
            self.times.ended_ns = self._now_ns()
