"""The ECU: a function of state, time and received frames, without clock, socket or thread.

Once a control period the ECU does the end-to-end check of the pressure frames, updates the fail-safe, extends the
window (`ecu.controller_memory`) and plans. It sends the plan's first action that was not sent before, limited by the
command gate. Neither frames, nor the time, nor the controller's answer can make the ECU raise an exception.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Unpack

import numpy as np

from can_bridge.bus.interface import HEALTHY, BusHealth, BusState
from can_bridge.command_gate import GatedCommand, GateLimits, Intervention, gate
from can_bridge.secoc.securing import Authentication, key_of
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import message_set
from can_bridge.wire.message_specs import FLOW_RESOLUTION_M2_PER_S
from can_bridge.wire.messages import EcuStatus, JetCommand, Reason
from contract.arrays import Array
from contract.config.tree import Config
from contract.controller.calibration import Calibration
from contract.controller.interface import Controller, ControllerError
from contract.controller.resampling import followed
from contract.release.checks import Bundle
from ecu.benefit_check import BenefitCheck, BenefitCheckState
from ecu.calibrating import limits_of, release_calibration, with_calibration
from ecu.controller_memory import ControllerMemory
from ecu.ecu_state import EcuState, Surroundings, Trace, answers
from ecu.fail_safe import FailSafe, OperatingMode, PeriodInputs
from ecu.fit import check_vehicle
from ecu.pressure_reception import PressureReception, Received, heard_of_another_ecu
from ecu.sensor_check import SensorCheckState, sensor_check_of
from ecu.speed_reception import SpeedReception
from ecu.timing import StepTiming


class Ecu:
    """An ECU with one controller of one bundle. `next` computes a control period from a state; `step` also stores the
    new state. Raises BundleError if the bundle was made for another vehicle, or for another number of sensors than the
    bus carries; ConfigError if only one of `bus.key` and `authentication` is given.

    Attributes:
        state: the state after the latest step; `restore` replaces it.
        calibration: the calibrated values in force; at power-on, the values of the release and the vehicle.
    """

    def __init__(
        self, bundle: Bundle, controller: Controller, config: Config, authentication: Authentication | None = None
    ) -> None:
        check_vehicle(bundle, config)
        manifest = bundle.manifest
        self._bundle_hash, self._controller = bundle.short_hash, controller
        self._config = self._own_config = config
        self._calibration_limits = limits_of(bundle, config)
        self._messages, self._key = message_set(config.bus), key_of(authentication, config.bus)
        self._period_ns, self._flow_scale = config.period_ns, config.operating_point.flow_rate_scale
        self._limits = self._own_limits = GateLimits.from_config(config)
        self._reception = PressureReception(
            message=self._messages.pressure,
            key=self._key,
            e2e=config.bus.e2e,
            dynamic_pressure=config.operating_point.dynamic_pressure,
            fresh_age_ns=self._limits.fresh_age_ns,
        )
        self._speed_reception = SpeedReception.of(manifest, config, self._messages.speed, self._key)
        self._sensor_check = sensor_check_of(bundle, config)
        self._benefit_check = BenefitCheck.of(manifest, config.ecu.benefit_check)
        self._longest_gap = config.ecu.hold_periods + config.ecu.decay_periods
        self.state = EcuState.power_on(
            window=manifest.window,
            sensors=len(manifest.sensors),
            horizon=manifest.mpc.horizon,
            delay=config.ecu.frozen_actions,
            past=0 if manifest.speeds is None else manifest.past,
            speed=None if self._speed_reception is None else self._speed_reception.start,
        ).authenticated(authentication, self._messages)
        self.restore(self.state)
        # The graph has the cost weights from its export, but the manifest of a renewed bundle has new weights.
        self.calibrate(release_calibration(bundle, config))

    def restore(self, state: EcuState) -> None:
        """Continue from a state of an ECU with equal bundle, settings and calibration. Raises ValueError if the state's
        window, number of sensors, horizon or delay differs from this ECU."""
        if (own := self.state.memory.sizes) != (found := state.memory.sizes):
            right = f"this ECU has {own}; build the ECU from the same bundle, settings and calibration"
            raise ValueError(f"the state is of a controller with (window, sensors, horizon, delay) = {found}: {right}")
        self.state = state
        mode, action = state.fail_safe.mode.on_wire, state.memory.under_way.newest
        self.trace = Trace(mode=mode, action=action, forces=None, interventions=Intervention(0))

    def calibrate(self, calibration: Calibration) -> None:
        """Put other values in force from the next step on; raises ConfigError for a value outside its limits."""
        self._calibration_limits.check(calibration)
        self.calibration = calibration
        self._weights = np.array(calibration.weights.as_tuple())
        self._config = with_calibration(self._own_config, calibration)
        # No bound may be wider than in the vehicle's settings, even if the check of the limits were wrong.
        self._limits = GateLimits.from_config(self._config).narrowed(self._own_limits)
        self.state = replace(self.state, memory=self.state.memory.with_delay(self._config.ecu.frozen_actions))

    def step(
        self, now_ns: int, frames: Sequence[Frame], health: BusHealth = HEALTHY, **around: Unpack[Surroundings]
    ) -> list[Frame]:
        """Do one control period. Returns a JetCommand and an EcuStatus.

        Args:
            now_ns: time of the step in ns, on the same clock as the frames' timestamps.
            frames: all frames received since the last step, oldest first.
            health: health of the CAN controller, for the status and the check for bus-off.
        """
        self.state, sent, self.trace = self.next(self.state, now_ns, frames, health, **around)
        return sent

    def next(
        self,
        state: EcuState,
        now_ns: int,
        frames: Sequence[Frame],
        health: BusHealth = HEALTHY,
        **around: Unpack[Surroundings],
    ) -> tuple[EcuState, list[Frame], Trace]:
        """Compute a control period from any state and store nothing. The function is pure if the controller is pure.
        Returns the next state, the frames to send (a JetCommand and an EcuStatus), and the trace."""
        received, inputs = self._receive(state, now_ns, frames, health, around)
        decided = replace(received, fail_safe=received.fail_safe.next(inputs, self._config.ecu))
        acted, passed, forces = self._act(decided, state.timing, now_ns)
        after = replace(acted.answered(self._messages), health=health)
        mode = after.fail_safe.mode
        command = JetCommand(
            flow_m2_per_s=passed.flow_m2_per_s,
            mode=mode.on_wire,
            enable=passed.enable,
            # A command has the counter of this period's pressures, or of older pressures from which it was computed.
            pressure_counter=after.pressure_counter if inputs.usable or mode.drives_jets else None,
            next_period=self._config.ecu.plan_ahead,
        )
        action, interventions = after.memory.under_way.newest, passed.interventions
        trace = Trace(mode=mode.on_wire, action=action, forces=forces, interventions=interventions)
        status = after.status(self._bundle_hash)
        return after, answers(state, command, status, now_ns, self._messages, self._key), trace

    def status(self) -> EcuStatus:
        """Return the health counters after the latest step."""
        return self.state.status(self._bundle_hash)

    def _receive(
        self, state: EcuState, now_ns: int, frames: Sequence[Frame], health: BusHealth, around: Surroundings
    ) -> tuple[EcuState, PeriodInputs]:
        timing = state.timing.next(now_ns, self._period_ns, self._config.ecu)
        speed_state, speed = state.speed, 1.0
        dynamic_pressure: float | None = self._config.operating_point.dynamic_pressure
        if self._speed_reception is not None:
            speed_state = self._speed_reception.next(speed_state, frames, now_ns)
            speed = self._speed_reception.present(speed_state)
            dynamic_pressure = self._speed_reception.dynamic_pressure(speed_state)
        received = self._reception.of(
            frames, now_ns, verifier=state.verifier, receiver=state.pressures, dynamic_pressure=dynamic_pressure
        )
        usable = received.cp is not None
        other_ecu = state.other_ecu.next(heard_of_another_ecu(frames, self._messages, self._key), timing.step_ns or 0)
        memory = self._after_silence(state.memory, timing)
        if speed_state.is_off:
            # The window is emptied: control within the speed range must not use pressures from outside the range.
            received, memory = received._replace(cp=None), memory.emptied()
        elif received.cp is None:
            memory = memory.bridged(self._longest_gap)
        else:
            memory = memory.observed(received.cp, speed)
        sensors, memory, sensor_fault = self._checked(state.sensors, memory, received, timing.skipped)
        benefit, no_benefit = self._judged(state, memory, speed, usable=received.cp is not None)
        if self._speed_reception is not None:
            is_sound = received.cp is not None and memory.is_full and sensors.set_aside is None
            speed_state = self._speed_reception.corrected(
                speed_state, memory.window if is_sound else None, drives=state.fail_safe.mode.drives_jets
            )
        bus_off = _bus_fault(state.health, health)
        after = replace(
            state,
            memory=memory,
            pressures=received.receiver,
            verifier=received.verifier,
            timing=timing,
            pressure_ns=received.sampled_ns if usable else state.pressure_ns,
            pressure_counter=received.counter if usable else state.pressure_counter,
            overruns=state.overruns + timing.skipped,
            missed=state.missed + (not usable),
            sensors=sensors,
            benefit=benefit,
            speed=speed_state,
            other_ecu=other_ecu,
        )
        return after, PeriodInputs(
            usable=usable,
            enable_request=received.enable_request,
            unusable_because=received.unusable_because,
            window_full=memory.is_full,
            off_speed=speed_state.is_off,
            tests=benefit.tests,
            fault=timing.fault or bus_off or other_ecu.fault or sensor_fault or no_benefit or around.get("fault"),
            updating=around.get("updating", False),
        )

    def _act(self, state: EcuState, before: StepTiming, now_ns: int) -> tuple[EcuState, GatedCommand, Array | None]:
        """Return the state with this period's action, the result of the command gate, and the predicted forces."""
        fail_safe, memory, latest = state.fail_safe, state.memory, state.memory.under_way.newest
        try:
            memory, action, forces = self._decide(fail_safe.mode, memory)
        except ControllerError:
            action, forces, fail_safe = 0.0, None, fail_safe.latch(Reason.INTERNAL)
        passed = gate(
            action * self._flow_scale,
            enable=fail_safe.mode.drives_jets,
            previous_m2_per_s=latest * self._flow_scale,
            previous_ns=before.step_ns,
            pressure_ns=state.pressure_ns,
            now_ns=now_ns,
            limits=self._limits,
        )
        # The action is rounded to the message's resolution, so that the memory has the action as it is sent.
        sent_m2_per_s = round(passed.flow_m2_per_s / FLOW_RESOLUTION_M2_PER_S) * FLOW_RESOLUTION_M2_PER_S
        memory = memory.commanded(sent_m2_per_s / self._flow_scale)
        after = replace(state, memory=memory, fail_safe=_told_by_the_gate(fail_safe, passed))
        return after, passed, forces

    def _after_silence(self, memory: ControllerMemory, timing: StepTiming) -> ControllerMemory:
        """Return the memory with a row for each skipped period. In these periods the last command stayed in force."""
        if timing.fault is Reason.CLOCK:
            # The clock is wrong, so the times of the rows are unknown and the rows are useless.
            return memory.emptied()
        # More rows would change nothing: after this number the window is empty, and the last command is in force.
        for _ in range(min(timing.skipped, max(self._longest_gap, len(memory.under_way.pending)) + 1)):
            memory = memory.bridged(self._longest_gap).commanded(memory.under_way.newest)
        return memory

    def _checked(
        self, state: SensorCheckState, memory: ControllerMemory, received: Received, skipped: int
    ) -> tuple[SensorCheckState, ControllerMemory, Reason | None]:
        if self._sensor_check is None:
            return state, memory, None
        after, fault = self._sensor_check.next(
            state, memory.window, memory.rows, received.cp, reading=received.reading, skipped=skipped
        )
        if after.set_aside is not None:
            memory = memory.with_column(after.set_aside, after.estimates[:, after.set_aside])
        return after, memory, fault

    def _judged(
        self, state: EcuState, memory: ControllerMemory, speed: float, *, usable: bool
    ) -> tuple[BenefitCheckState, Reason | None]:
        """Return the benefit check's state, and the fault or None. `memory` has estimates for a faulty sensor."""
        if self._benefit_check is None:
            return state.benefit, None
        cp = memory.window[-1, :-1] if usable else None
        return self._benefit_check.next(state.benefit, cp, drives=state.fail_safe.mode.drives_jets, speed=speed)

    def _decide(self, mode: OperatingMode, memory: ControllerMemory) -> tuple[ControllerMemory, float, Array | None]:
        """Return the memory with this period's plan, the action in U_inf W for the command gate, and the predicted
        (Cd, Cl) in the H steps of the horizon, (H, 2). Only CONTROL has a new plan and forces. `memory` already has
        this period's row. Raises ControllerError if the controller fails."""
        latest = memory.under_way.newest
        if mode is OperatingMode.CONTROL:
            planned, answer = memory.planned(self._controller, self._weights, self._config.flow.action_limit)
            speed, wanted = memory.speed, float(answer.plan[self._config.ecu.frozen_actions])
            return planned, followed(latest, wanted * speed, speed * speed), answer.forces * speed**2
        if mode is OperatingMode.HOLD:
            return memory, latest, None
        if mode is OperatingMode.DECAY:
            return memory, 0.5 * latest, None
        return memory.without_plan(), 0.0, None


def _bus_fault(before: BusHealth, now: BusHealth) -> Reason | None:
    """Return BUS_OFF during bus-off, or if a bus-off began since the last step: the last frames may be lost."""
    return Reason.BUS_OFF if now.state is BusState.BUS_OFF or now.bus_off > before.bus_off else None


def _told_by_the_gate(fail_safe: FailSafe, passed: GatedCommand) -> FailSafe:
    """Return the fail-safe after the command gate. If the gate shut the jets, the fail-safe's `reason` states why."""
    if Intervention.NOT_FINITE in passed.interventions:
        return fail_safe.latch(Reason.INTERNAL)
    if Intervention.STALE in passed.interventions:
        return replace(fail_safe, reason=Reason.STALE)
    return fail_safe
