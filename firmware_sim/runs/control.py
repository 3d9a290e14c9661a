"""The evaluation of a run's control: whether the controller was in control when requested and, if not, why."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from can_bridge.wire.messages import Mode, Reason
from contract.arrays import Mask
from firmware_sim.runs.reasons import BECAUSE
from firmware_sim.runs.run_log import RunLog
from firmware_sim.runs.statistics import planned_steps

SKIPPED: Final = "SKIPPED"
"""Name used instead of a mode for a period that the ECU skipped because it was still computing or booting."""
KEYS_DIFFER: Final = "Frames arrived, but none was authentic: do both nodes have the same key (bus.key)?"


@dataclass(frozen=True, kw_only=True)
class LatchedFault:
    """The first fault that latched while control was requested. The fields are the name of its Reason, the start (in
    t_c) and index of its period, and the number of control periods from the request to the fault."""

    reason: str
    t: float
    period: int
    after_enable: int


@dataclass(frozen=True, kw_only=True)
class RunControl:
    """The counts of the control periods in which control was requested. `modes` has their number in each mode of the
    ECU, by the name of the mode or SKIPPED. In the first `warm_up` of them the controller's window was still filling.
    `fault` is the first latched fault, if any. `shut` is the share with shut jets, 0 to 1."""

    requested: int
    modes: Mapping[str, int]
    warm_up: int
    fault: LatchedFault | None
    shut: float

    @property
    def in_control(self) -> int:
        """Number of periods in which the controller planned."""
        return self.modes.get(Mode.CONTROL.name, 0)

    @property
    def held(self) -> bool:
        """Whether no fault latched, and the controller planned in all periods with a request after the warm-up."""
        return self.fault is None and self.in_control > 0 and self.in_control + self.warm_up == self.requested


def mode_names(log: RunLog) -> list[str]:
    """Return the mode of every period, or SKIPPED."""
    modes = zip(log.series["mode"].astype(int), np.isnan(log.series["step_ms"]), strict=True)
    return [SKIPPED if left_out else Mode(mode).name for mode, left_out in modes]


def mode_spans(log: RunLog) -> list[tuple[str, int, int]]:
    """Return (mode or SKIPPED, first period, period after the last) of every span of equal modes, in order of time."""
    names = np.array(mode_names(log))
    edges = [0, *(np.flatnonzero(names[1:] != names[:-1]) + 1).tolist(), len(names)]
    return [(str(names[first]), first, after) for first, after in pairwise(edges) if after > first]


def control(log: RunLog) -> RunControl:
    """Evaluate control in a run, from the period in which control is first requested."""
    modes, names = log.series["mode"][log.enabled_at :], mode_names(log)[log.enabled_at :]
    faulted = np.flatnonzero(modes == Mode.FAULT)
    warm = np.flatnonzero(np.array(names) != Mode.WARMUP.name)
    still = log.series["action"][log.enabled_at :] == 0.0
    # The first sample is left out, because the jets cannot have moved before the first command.
    shut = float(still[1:].mean()) if len(still) > 1 else 1.0
    fault = None
    if len(faulted):
        after_enable = int(faulted[0])
        period = log.enabled_at + after_enable
        reason = Reason(int(log.series["reason"][period])).name
        fault = LatchedFault(reason=reason, t=float(log.series["t"][period]), period=period, after_enable=after_enable)
    counts = {name: names.count(name) for name in (*Mode.__members__, SKIPPED) if name in names}
    warm_up = int(warm[0]) if len(warm) else len(names)
    return RunControl(requested=len(names), modes=counts, warm_up=warm_up, fault=fault, shut=shut)


def set_aside(log: RunLog) -> list[tuple[str, int]]:
    """Return each sensor that the ECU excluded as faulty, with the first period of its exclusion, in order of time."""
    bits = log.series["set_aside"].astype(int)
    found = []
    for index, name in enumerate(log.metadata.sensors):
        on = np.concatenate([[0], bits >> index & 1])
        found += [(name, int(period)) for period in np.flatnonzero(np.diff(on) > 0)]
    return sorted(found, key=lambda one: one[1])


def trouble(log: RunLog) -> str | None:
    """Return the sentence, shown first on pages, on why the controller was not always in control; None if it was."""
    found = control(log)
    if found.held:
        return None
    refused = bool((log.series["reason"][log.enabled_at :] == Reason.NOT_AUTHENTIC).any())
    return f"{_not_held(log, found)} {KEYS_DIFFER}" if refused else _not_held(log, found)


def _not_held(log: RunLog, found: RunControl) -> str:
    if (fault := found.fault) is not None:
        latched = f"{fault.reason} at t = {fault.t:.1f} t_c, {_periods(fault.after_enable)} after enable"
        return f"ECU FAULT: {latched}; the jets were shut for {100 * found.shut:.0f} % of the controlled time."
    if not found.requested:
        return "NOT IN CONTROL: control was not requested."
    share = f"in control {found.in_control} of {_periods(found.requested)}"
    reasons = log.series["reason"][log.enabled_at :]
    waited = {reason: int((reasons == reason).sum()) for reason in (Reason.OFF_SPEED, Reason.NOT_HELPING)}
    if found.warm_up == found.requested:
        filling = "the controller's window was still filling at the end"
        return f"NOT IN CONTROL: {share}; {BECAUSE[Reason.OFF_SPEED] if waited[Reason.OFF_SPEED] else filling}."
    others = [f"{name} {count}" for name, count in found.modes.items() if name != Mode.CONTROL.name]
    others += [f"of these {reason.name} {count}" for reason, count in waited.items() if count]
    return f"CONTROL NOT HELD: {share} ({', '.join(others)})."


def held_while_averaged(log: RunLog, averaged: Mask) -> bool:
    """Return whether no fault latched, and the controller planned in each period marked in `averaged`, shape (n,)."""
    return bool(planned_steps(log)[averaged].all()) and control(log).fault is None


def _periods(count: int) -> str:
    return f"{count} period{'' if count == 1 else 's'}"
