"""When the vehicle requests control: as a viewer wants, by itself after a lead-in, and again after a latched fault."""

from dataclasses import dataclass

from ecu.fail_safe import FailSafe, OperatingMode

_NEEDS_A_RISE = (OperatingMode.INIT, OperatingMode.STANDBY, OperatingMode.FAULT)
"""States that a request which stands does not lead out of."""


@dataclass(kw_only=True)
class ControlRequest:
    """The request in one run of the loop.

    Attributes:
        lead_in: periods after which control is requested.
        rearm_frames: good frames in a row that the ECU needs before a request ends a latched fault.
        wanted: control is, once the lead-in is over.
        waits: the lead-in is not over; a viewer who asks for control ends it.
        rearming: the request is low until a rise can have its effect.
        helped_until: period up to which what latches is ended by a new request, without a viewer's doing.
        first: period in which control was first requested; None before.
    """

    lead_in: int
    rearm_frames: int
    wanted: bool = False
    waits: bool = True
    rearming: bool = False
    helped_until: int = 0
    first: int | None = None

    def set(self, wanted: bool) -> None:
        """Set what a viewer wants."""
        self.wanted, self.waits, self.rearming = wanted, False, False

    def rearm(self, fail_safe: FailSafe, *, given_up: bool) -> bool:
        """Take the request back if only a new one leads on; whether it is now."""
        latched = given_up or fail_safe.mode in _NEEDS_A_RISE
        self.rearming = self.rearming or (self.first is not None and self.wanted and latched)
        return self.rearming

    def begins(self, k: int) -> bool:
        """Whether the lead-in ends with period k; asked once a period."""
        if not (self.waits and k >= self.lead_in):
            return False
        self.wanted, self.waits = True, False
        return True

    def requests(self, k: int, fail_safe: FailSafe, *, is_up: bool, given_up: bool) -> bool:
        """Whether control is requested in period k.

        Args:
            fail_safe: of the ECU after the period before.
            given_up: the vehicle has, until its own request was low.
        """
        if self.rearming and is_up and not given_up and self._may_rise(fail_safe):
            self.rearming = False
        elif k < self.helped_until:
            self.rearm(fail_safe, given_up=given_up)
        requested = self.wanted and not self.rearming
        if requested and self.first is None:
            self.first = k
        return requested

    def _may_rise(self, fail_safe: FailSafe) -> bool:
        """Whether the ECU has seen the request low, and takes a rise for what it is."""
        if fail_safe.enable_request:
            return False
        if fail_safe.mode is OperatingMode.FAULT:
            # The frame of the rise is a good one, too.
            return fail_safe.good + 1 >= self.rearm_frames
        return fail_safe.mode is OperatingMode.ARMED
