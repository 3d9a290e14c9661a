"""The control loop. Its absolute deadlines follow the arrivals of the pressures that were used. In each period the loop
wakes, takes the frames that another thread has read, computes a step, and sends the answers."""

import gc
import resource
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

from can_bridge.bus.heard import SILENCE_S, Heard, Silence
from can_bridge.e2e.profiles import profile_of
from can_bridge.e2e.receiver import GOOD, ReceiverState
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import message_set
from can_bridge.wire.messages import Mode, Reason
from contract.config.tree import Config
from ecu.daemon.connection import Connection, Tell
from ecu.daemon.reception import FrameReception
from ecu.daemon.reporter import Counters
from ecu.fail_safe import FailSafe
from ecu.fit import check_offset
from ecu.pressure_reception import OtherEcu
from ecu.real_time import clock
from ecu.real_time.deadlines import Arrivals, Deadlines
from ecu.real_time.stage_times import NOTHING, EcuStage, PlanTimes, StageTimes
from ecu.stepped import SteppedEcu

GRACE: Final = 4
"""Divisor of the period: a step may begin late by up to a period / GRACE. A step that would begin later is skipped."""
SHUT_FRAMES: Final = 3
"""Number of last periods, whose commands shut the jets. There are several, because a single frame may be lost."""


class ControlLoop:
    """The control loop of one ECU on one bus. `tell` is called with an event's name, its text, and its fields. Raises
    ConfigError if the step's offset is not shorter than the period."""

    def __init__(
        self,
        ecu: SteppedEcu,
        times: PlanTimes,
        connection: Connection,
        reception: FrameReception,
        config: Config,
        *,
        tell: Tell,
        after_step: Callable[[int, Counters], None] = lambda now_ns, counters: None,
        stage_times: StageTimes | None = None,
        now_ns: Callable[[], int] = clock.now_ns,
        sleep_until: Callable[[int], None] = clock.sleep_until,
    ) -> None:
        self._ecu, self._times, self._connection, self._reception = ecu, times, connection, reception
        self._tell, self._after_step, self._stages = tell, after_step, stage_times
        self._now_ns, self._sleep_until = now_ns, sleep_until
        messages = message_set(config.bus)
        self._pressure = messages.pressure.spec
        self._silence = Silence(self._pressure, messages, "vehicle", lambda text: tell("heard", text))
        self._sound, self._offset_ns = 0, check_offset(config)
        period_ns = config.period_ns
        self._look_every = max(1, round(SILENCE_S * 1e9 / period_ns))
        self._deadlines = Deadlines(period_ns=period_ns, due_ns=now_ns() + period_ns, grace_ns=period_ns // GRACE)
        self._arrivals = Arrivals(period_ns=period_ns)
        self._told: tuple[Mode, Reason] | None = None
        self._usage = _usage()
        self.counters = Counters(state=ecu.state)

    def run(self, is_stopped: Callable[[], bool], periods: int | None = None) -> None:
        while not is_stopped() and (periods is None or self.counters.steps < periods):
            self.period()

    def period(self) -> None:
        """Wait for the deadline, do a step, and set the next deadline."""
        due_ns = self._deadlines.due_ns
        self._sleep_until(due_ns)
        woke_ns = self._now_ns()
        if self._connection.look(self._tell):
            self._arrivals = Arrivals(period_ns=self._arrivals.period_ns)  # the sender may have changed
        pressures, others = self._reception.take()
        before = self._ecu.state
        self._times.forget()
        began_ns = self._now_ns()
        answers = self._ecu.step(began_ns, others + pressures, self._connection.health())
        ended_ns = self._now_ns()
        sent = self._connection.send(answers)
        sent_ns = self._now_ns()
        if self._stages is not None:
            self._note(self._stages, pressures, due_ns, woke_ns, began_ns, ended_ns, sent_ns if sent else 0)
        if self._ecu.state.missed == before.missed:
            # Only pressures that the ECU used move the deadlines; frames of another node have no influence.
            counters = [self._counter(frame) for frame in pressures]
            if (used := self._ecu.state.pressure_counter) in counters:
                self._arrivals = self._arrivals.seen(pressures[counters.index(used)].timestamp_ns)
        self._sound += self._is_sound(before.pressures, pressures)
        self._count(due_ns, woke_ns, sent_ns)
        self._tell_other_ecu(before.other_ecu)
        self._tell_mode()
        if self.counters.steps % self._look_every == 0:
            self._silence.look(self._sound, self._reception.heard, self._connection.rejected())
            self._reception.heard = Heard()
        self._after_step(sent_ns, self.counters)
        self._deadlines = self._deadlines.after(self._now_ns())
        if (expected_ns := self._arrivals.expected_ns) is not None:
            self._deadlines = self._deadlines.slewed(expected_ns + self._offset_ns)

    def shut(self) -> None:
        """Send the last frames: the jet flow is zero and the jets are not enabled, as at power-on."""
        self._ecu.restore(replace(self._ecu.state, fail_safe=FailSafe()))
        for _ in range(SHUT_FRAMES):
            self._sleep_until(self._deadlines.due_ns)
            self._connection.send(self._ecu.step(self._now_ns(), [], self._connection.health()))
            self._deadlines = self._deadlines.after(self._now_ns())
        # The file of counters remains when the process ends, so it must state that the jets are shut.
        shut = replace(self.counters.state, fail_safe=self._ecu.state.fail_safe)
        self.counters = replace(self.counters, state=shut, action=self._ecu.trace.action)
        self._after_step(self._now_ns(), self.counters)

    def _is_sound(self, before: ReceiverState, frames: Sequence[Frame]) -> bool:
        """Return whether a pressure frame of this period passed authentication and the E2E check. It may still be
        unusable, but its DBC and key are right. An ECU without a release checks no frame, so every frame counts."""
        now = self._ecu.state.pressures
        return bool(frames) if now == before else any(now.count(check) > before.count(check) for check in GOOD)

    def _tell_other_ecu(self, before: OtherEcu) -> None:
        now = self._ecu.state.other_ecu
        if before.fault is None and now.fault is not None:
            self._tell("other_ecu", "another ECU is on this bus: jets shut", frames=now.frames - before.frames)
        elif before.fault is not None and now.fault is None:
            self._tell("other_ecu_gone", "the other ECU is silent; for control, the enable request must rise again")

    def _tell_mode(self) -> None:
        state = self._ecu.state.fail_safe
        mode, reason = state.mode.on_wire, state.reason
        if (mode, reason) != self._told and mode not in (Mode.HOLD, Mode.DECAY):  # these two last only briefly
            self._told = mode, reason
            because = "" if reason is Reason.NONE else f", {reason.name}"
            self._tell("mode", f"{mode.name}{because}", mode=mode.name, reason=reason.name)

    def _count(self, due_ns: int, woke_ns: int, sent_ns: int) -> None:
        before = self.counters
        self.counters = Counters(
            state=self._ecu.state,
            steps=before.steps + 1,
            left_out=self._deadlines.left_out,
            received=self._reception.received,
            dropped=self._reception.dropped,
            not_sent=self._connection.not_sent,
            losses=self._connection.losses,
            action=self._ecu.trace.action,
            busy_ns=before.busy_ns + sent_ns - woke_ns,
            longest_ns=max(before.longest_ns, sent_ns - woke_ns),
            latest_wake_ns=max(before.latest_wake_ns, woke_ns - due_ns),
        )

    def _counter(self, frame: Frame) -> int:
        is_whole = len(frame.data) == self._pressure.length
        return profile_of(self._pressure).counter_of(frame.data) if is_whole else NOTHING

    def _note(self, stages: StageTimes, frames: Sequence[Frame], *times_ns: int) -> None:
        """Store this period's times: deadline, waking, start and end of the step, and end of sending."""
        due_ns, woke_ns, began_ns, ended_ns, sent_ns = times_ns
        usage = _usage()
        since = [now - before for now, before in zip(usage, self._usage, strict=True)]
        self._usage = usage
        counter, arrived_ns = (self._counter(frames[-1]), frames[-1].timestamp_ns) if frames else (NOTHING, 0)
        until = self._deadlines.number, due_ns, woke_ns, counter, arrived_ns, began_ns
        values = (*until, self._times.began_ns, self._times.ended_ns, ended_ns, sent_ns, *since)
        stages.begin()
        for stage, value in zip(EcuStage, values, strict=True):
            stages.note(stage, value)


def _usage() -> tuple[int, int, int, int]:
    """Return the process's number of garbage collections, and this thread's numbers of minor page faults, major page
    faults and involuntary context switches. On a system other than Linux, all numbers are the process's numbers."""
    used = resource.getrusage(getattr(resource, "RUSAGE_THREAD", resource.RUSAGE_SELF))
    return sum(item["collections"] for item in gc.get_stats()), used.ru_minflt, used.ru_majflt, used.ru_nivcsw
