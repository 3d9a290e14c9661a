"""The ECU: a function of time and received frames, without clock, socket or thread.

Once a control period: check the pressure stream end to end, update the fail-safe, extend the window, plan, pass the
first free action through the command gate, send it. The row of the window at period k is (Cp_k, a_{k-1}) with the
action as it went out on the wire, and as it takes effect if the actuator is known to be late.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from can_bridge.command_gate import GateLimits, Intervention, gate
from can_bridge.e2e.receiver import Check, E2eReceiver, StreamState
from can_bridge.e2e.sender import E2eSender
from can_bridge.wire import codec
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import ECU_STATUS, FLOW_RESOLUTION_M2_PER_S, JET_COMMAND, PRESSURE
from can_bridge.wire.messages import COUNT_LIMIT, SENSORS, EcuStatus, JetCommand, Mode, Pressure, Reason
from contract.config.tree import Config
from contract.controller.interface import Controller, ControllerError
from contract.errors import BundleError
from contract.release.bundle import Bundle
from firmware_sim.ecu.state_machine import FailSafe
from firmware_sim.ecu.window import History

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Trace:
    """What happened in the latest step, for observers; nothing in the ECU reads it.

    Attributes:
        mode: of the loop.
        action: sent, in U_inf W.
        forces: predicted (Cd, Cl) over the horizon, (H, 2); None without a plan.
        interventions: of the command gate.
    """

    mode: Mode
    action: float
    forces: Array | None
    interventions: Intervention


class Ecu:
    """One controller from one bundle.

    Args:
        bundle: verified release.
        controller: what runs its `controller.onnx`.
        config: bus, E2E and fail-safe settings; operating point and control period must be the bundle's.

    Raises:
        BundleError: if the bundle was made for another vehicle or another number of sensors than the bus carries.
    """

    def __init__(self, bundle: Bundle, controller: Controller, config: Config) -> None:
        _check_fit(bundle, config)
        manifest = bundle.manifest
        self._bundle_hash = bundle.short_hash
        self._controller = controller
        self._config = config
        self._dynamic_pressure = config.operating_point.dynamic_pressure
        self._flow_scale = config.operating_point.flow_rate_scale
        self._limits = GateLimits.from_config(config)
        self._receiver = E2eReceiver(PRESSURE, config.bus.e2e)
        self._commands, self._statuses = E2eSender(JET_COMMAND), E2eSender(ECU_STATUS)
        self._history = History(manifest.window, config.ecu.hold_periods + config.ecu.decay_periods)
        delay = config.ecu.delay_steps
        self._free = np.ones(manifest.mpc.horizon)
        self._free[:delay] = 0.0
        self._plan = np.zeros(manifest.mpc.horizon)
        # Oldest first; the front is what takes effect now if the actuator is `delay` periods late.
        self._sent = deque([0.0] * (delay + 1), maxlen=delay + 1)
        self._fail_safe = FailSafe()
        self._last_step_ns: int | None = None
        self._pressure_ns: int | None = None
        self._overruns = 0
        self._late_in_a_row = 0
        self._missed = 0
        self.trace = Trace(mode=Mode.OFF, action=0.0, forces=None, interventions=Intervention(0))

    def step(self, now_ns: int, frames: Sequence[Frame]) -> list[Frame]:
        """One control period.

        Args:
            now_ns: time of the step, in the clock of the frames' timestamps.
            frames: everything received since the last step, oldest first.

        Returns:
            A JetCommand and an EcuStatus.
        """
        self._skip(now_ns)
        pressure, reason = self._receive(frames)
        usable = pressure is not None and all(pressure.valid)
        self._fail_safe = self._fail_safe.next_state(
            usable=usable,
            enable_request=None if pressure is None else pressure.enable_request,
            reason=reason,
            config=self._config.ecu,
        )
        if usable and pressure is not None:
            self._history.append(np.array(pressure.pressure_pa) / self._dynamic_pressure, self._sent[0])
        else:
            self._missed += 1
            self._history.repeat_last(self._sent[0])
        mode = self._fail_safe.mode(window_full=self._history.is_full, config=self._config.ecu)
        wanted, forces = self._decide(mode)
        # Deciding may end in a latched fault of its own.
        mode = self._fail_safe.mode(window_full=self._history.is_full, config=self._config.ecu)
        passed = gate(
            wanted * self._flow_scale,
            enable=mode in (Mode.CONTROL, Mode.HOLD, Mode.DECAY),
            previous_m2_per_s=self._sent[-1] * self._flow_scale,
            pressure_ns=self._pressure_ns,
            now_ns=now_ns,
            limits=self._limits,
        )
        command = JetCommand(
            flow_m2_per_s=passed.flow_m2_per_s,
            mode=mode,
            enable=passed.enable,
            pressure_counter=self._receiver.last_counter,
        )
        on_wire = round(passed.flow_m2_per_s / FLOW_RESOLUTION_M2_PER_S) * FLOW_RESOLUTION_M2_PER_S
        self._sent.append(on_wire / self._flow_scale)
        self.trace = Trace(mode=mode, action=self._sent[-1], forces=forces, interventions=passed.interventions)
        return [
            self._commands.frame(codec.emit_jet_command(command), now_ns=now_ns),
            self._statuses.frame(codec.emit_ecu_status(self.status()), now_ns=now_ns),
        ]

    def status(self) -> EcuStatus:
        """Health counters as of the latest step."""
        return EcuStatus(
            state=self.trace.mode,
            reason=self._fail_safe.reason,
            overruns=min(self._overruns, COUNT_LIMIT),
            missed=min(self._missed, COUNT_LIMIT),
            crc_errors=min(self._receiver.counts[Check.ERROR], COUNT_LIMIT),
            bus_off=0,
            bundle_hash=self._bundle_hash,
        )

    @property
    def frames_rejected(self) -> int:
        """Pressure frames that came but failed their end-to-end check."""
        return sum(self._receiver.counts[check] for check in (Check.ERROR, Check.REPEATED, Check.WRONG_SEQUENCE))

    def _skip(self, now_ns: int) -> None:
        """Count the whole periods since the last step beyond one, in which the last command stayed in force.

        An ECU that is late again and again cannot keep its budget: it switches itself off.
        """
        if self._last_step_ns is not None:
            skipped = max(0, round((now_ns - self._last_step_ns) / self._config.period_ns) - 1)
            self._overruns += skipped
            self._late_in_a_row = self._late_in_a_row + 1 if skipped else 0
            if self._late_in_a_row >= self._config.ecu.deadline_misses:
                self._fail_safe = self._fail_safe.latch(Reason.DEADLINE)
            # The window keeps one row a period. Counting further than the count goes changes nothing more.
            for _ in range(min(skipped, COUNT_LIMIT)):
                self._history.repeat_last(self._sent[0])
                self._sent.append(self._sent[-1])
        self._last_step_ns = now_ns

    def _receive(self, frames: Sequence[Frame]) -> tuple[Pressure | None, Reason]:
        """The newest trusted pressures, and why there are none or why they cannot be used."""
        reception = self._receiver.tick(frames)
        frame = reception.live
        pressure = None if frame is None else codec.parse_pressure(frame.data)
        if frame is None or pressure is None:
            trusted = reception.state is not StreamState.INVALID
            return None, Reason.STREAM_LOST if trusted else Reason.STREAM_INVALID
        # A frame that waited in a queue, or was late before it was sent, is as old as it is.
        self._pressure_ns = frame.timestamp_ns - pressure.age_ns
        return pressure, Reason.SENSOR_INVALID

    def _decide(self, mode: Mode) -> tuple[float, Array | None]:
        """The wanted action and the predicted forces."""
        if mode is Mode.CONTROL:
            plan = self._plan.copy()
            # The graph shifts the plan by a step. What comes first then is under way to a late actuator: as sent,
            # whatever the gate, a hold or the wire made of the plan.
            plan[1 : len(self._sent)] = list(self._sent)[1:]
            try:
                planned = self._controller.control_step(self._history.window(), plan, self._free)
            except ControllerError:
                planned = None
            if planned is None or not (np.isfinite(planned.plan).all() and np.isfinite(planned.forces).all()):
                self._fail_safe = self._fail_safe.latch(Reason.INTERNAL)
                return 0.0, None
            self._plan = planned.plan
            return float(planned.plan[self._config.ecu.delay_steps]), planned.forces
        if mode is Mode.HOLD:
            return self._sent[-1], None
        if mode is Mode.DECAY:
            return 0.5 * self._sent[-1], None
        self._plan = np.zeros_like(self._plan)
        return 0.0, None


def _check_fit(bundle: Bundle, config: Config) -> None:
    manifest = bundle.manifest
    facts = {
        "operating point": (manifest.operating_point, config.operating_point),
        "control period": (manifest.control_period, config.flow.control_period),
        "action limit": (manifest.action_limit, config.flow.action_limit),
    }
    for name, (built_for, here) in facts.items():
        if built_for != here:
            raise BundleError(
                f"bundle {manifest.name!r} was built for another {name}: {built_for}, the vehicle has {here}"
            )
    if len(manifest.sensors) != SENSORS:
        raise BundleError(
            f"bundle {manifest.name!r} has {len(manifest.sensors)} sensors: the Pressure message carries {SENSORS}"
        )
    if config.ecu.delay_steps >= manifest.mpc.horizon:
        raise BundleError(
            f"ecu.delay_steps = {config.ecu.delay_steps}: must be below the horizon {manifest.mpc.horizon}"
        )
