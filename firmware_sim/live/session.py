"""The live loop as an object: stepped period by period, set by viewers, asked for what is new.

No socket, process or thread, and no clock but those it is given: whoever drives it decides when a period passes. The
loop is the one of a run (`firmware_sim.bench.simulation`): with the settings left alone, row by row the same.
"""

import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from typing import Any, ClassVar, Final

from contract.config.tree import Config
from contract.errors import ConfigError, StillwakeError
from contract.release.checks import Bundle
from contract.runtime.copies import NeverCopied
from ecu.calibrating import limits_of, release_calibration
from ecu.ecu_state import EcuState
from ecu.fit import check_sensors
from ecu.stepped import LoopEcu
from firmware_sim.bench.virtual_loop import check_bit_rates
from firmware_sim.live import present
from firmware_sim.live.loop.live_run import LivePeriod, LiveRun
from firmware_sim.live.loop.messages import Choice, LiveAnswer, LiveMessage, pack_field
from firmware_sim.live.loop.noticing import FIRST_SEEN, EventLog, noticed
from firmware_sim.live.settings import CONTROLLERS, Asked, LiveSettings, asked, changes
from wake.plant.protocol import LoopPlant

OFF: Final = "off"
"""The controller that is none."""
_PACE: Final = 50
"""Latest periods whose wall-clock times give the frames a second."""
_SELDOM: Final = 5
"""Periods from one table of the bus to the next."""


class LiveSession(NeverCopied):
    """One loop and what its viewers have set. Raises StillwakeError if plant or ECU cannot be had, or do not fit each
    other, the bundle and the vehicle.

    Args:
        config: the vehicle; its operating point and control period must be the bundle's.
        wake: a plant at its start, by its name.
        ecu: makes an ECU, just powered on, by the controller's name; each is made once.
        ahead: of a controller's name what makes its ECU ahead, because that takes seconds; None where it does not.
        controllers, plants: what there is to choose, and what is missing.
        settings: to begin with. Whether control is requested in them counts for nothing: it is after `lead_in`.
        lead_in: t_c from a start until control is requested by itself.
        kept: latest periods that a page should keep, and that wait for `messages` at most.
        clock: wall clock in s.
    """

    INSTEAD: ClassVar = "bus and nodes call each other; make another one, which goes the same way to the bit"

    def __init__(
        self,
        *,
        bundle: Bundle,
        config: Config,
        wake: Callable[[str], LoopPlant],
        ecu: Callable[[str], LoopEcu],
        ahead: Callable[[str], Callable[[], None] | None] = lambda name: None,
        controllers: Sequence[Choice],
        plants: Sequence[Choice],
        settings: LiveSettings | None = None,
        lead_in: float = 10.0,
        kept: int = 3000,
        seed: int = 0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        check_bit_rates(config)
        if config.bus.key:
            raise ConfigError("bus.key: the live loop has no authentication; leave it empty")
        self._bundle, self._config, self._wake = bundle, config, wake
        self._make_ecu, self._ahead = ecu, ahead
        self._own, self._limits = release_calibration(bundle, config), limits_of(bundle, config)
        self._made: dict[str, tuple[LoopEcu, EcuState]] = {}
        self._choices = {"controller": tuple(controllers), "plant": tuple(plants)}
        self._clock = clock
        self._lead_in = round(lead_in / config.flow.control_period)
        self._kept, self._seed = kept, seed
        self._automatic = True
        self._paused = False
        self._hello_due = self._settings_due = self._now_due = False
        self._seen = FIRST_SEEN
        self._runs = 0
        self._events = EventLog()
        self._rows: list[LivePeriod] = []
        self._ticks: deque[float] = deque(maxlen=_PACE)
        self._settings = LiveSettings() if settings is None else settings
        if self._settings.weights == self._own.weights:
            self._settings = replace(self._settings, weights=None)
        self._check_choices(self._settings)
        self._start(self._settings)

    def step(self) -> None:
        """One control period; none while the loop is paused. Raises StillwakeError if the flow diverges."""
        if self._paused:
            return
        run = self._run
        if run.request.begins(run.k):
            self._settings = replace(self._settings, enable=True)
            self._settings_due = True
            self._note("loop", "the lead-in is over: the vehicle requests control")
        latest = run.step()
        self._rows.append(latest)
        del self._rows[: -self._kept]
        self._ticks.append(self._clock())
        seen = run.seen()
        for kind, text in noticed(self._seen, seen):
            self._note(kind, text)
        self._seen = seen
        self._events.pass_to(run.time_s(run.k), latest.row.sample.t)
        self._now_due = True

    def before(self, request: object) -> Callable[[], None] | None:
        """What makes the ECU that is asked for, in a thread of its own; None where it is there, or cannot be had."""
        try:
            action, value = asked(request)
            if action != "set":
                return None
            after = self._changed(value)
            self._check_choices(after)
        except StillwakeError:
            return None
        return self._ahead(after.controller)

    def handle(self, request: object) -> LiveAnswer:
        """Do what a viewer asks for, between two periods; any value of JSON may come."""
        answer: LiveAnswer = {}
        try:
            self._do(asked(request), answer)
        except StillwakeError as error:
            answer["error"] = " ".join(str(error).split())
        return answer

    def messages(self) -> list[LiveMessage | bytes]:
        """What is new since this was asked last."""
        run, out = self._run, list[LiveMessage | bytes]()
        if self._hello_due:
            out.append(
                present.hello(run, self._bundle, self._config, self._settings, choices=self._choices, kept=self._kept)
            )
        if self._rows:
            out.append(present.periods(run.number, self._rows, run.wake.layout.base))
        if items := self._events.new():
            out.append({"type": "events", "run": run.number, "items": items})
        if self._settings_due:
            out.append({"type": "settings", "settings": asdict(self._settings)})
        if self._now_due and run.latest is not None:
            out += self._present(run.latest)
        self._rows = []
        self._hello_due = self._settings_due = self._now_due = False
        return out

    # What viewers ask for.

    def _do(self, request: Asked, answer: LiveAnswer) -> None:
        match request.action:
            case "set":
                self._apply(self._changed(request.value), enable=request.value.get("enable"))
            case "clear":
                answer["note"] = self._clear()
            case "power_cycle":
                self._power_cycle()
            case "pause":
                self._pause(request.value)
            case "restart":
                self._start(self._settings)
                self._note("set", "the plant starts again")

    def _changed(self, given: dict[str, Any]) -> LiveSettings:
        return self._settings.changed(given, self._bundle.manifest.sensors, self._own, self._limits)

    def _apply(self, after: LiveSettings, *, enable: bool | None) -> None:
        """Have other settings from the next period on; if that cannot be, an error, and all is as it was."""
        before, run = self._settings, self._run
        self._check_choices(after)
        if after.plant != before.plant:
            self._start(after)
            run = self._run
        elif (after.controller, after.weights) != (before.controller, before.weights):
            self._exchange(before, after)
        if enable is not None:
            self._automatic = enable
            run.request.set(enable)
        run.set_disturbances(after.disturbances)
        self._settings = replace(after, enable=run.request.wanted)
        self._settings_due = True
        labels = {choice["name"]: choice["label"] for choice in self._choices["controller"]}
        for text in changes(before, self._settings, self._own.weights, labels):
            self._note("set", text)

    def _exchange(self, before: LiveSettings, after: LiveSettings) -> None:
        """Another ECU, another goal, or none."""
        run = self._run
        if after.controller == OFF:
            if before.controller != OFF:
                run.cut_supply()
            return
        run.exchange(self._ecu(after.controller, after))
        if before.controller == OFF:
            run.power_on()

    def _clear(self) -> str:
        """Everything but request, controller and plant as at the start; what has latched is ended by a new request."""
        self._apply(self._settings.without_faults, enable=None)
        text = "cleared"
        if self._run.state.sensors.set_aside is not None and not self._run.is_off:
            text += "; the ECU starts again, and believes all sensors again"
        if self._run.help():
            text += "; the request is taken back for a moment, since only a new one leads on"
        self._note("set", text)
        return text

    def _power_cycle(self) -> None:
        if self._settings.controller == OFF:
            raise ConfigError("power cycle: the ECU has no supply; choose a controller, and it starts")
        self._run.power_on()
        self._note("set", "the ECU's supply is cut for a moment")

    def _pause(self, value: bool) -> None:
        self._paused, self._now_due = value, True
        self._ticks.clear()

    # Beginning.

    def _start(self, settings: LiveSettings) -> None:
        """Begin at the plant's start, with these settings; if that cannot be, an error, and all is as it was."""
        is_off = settings.controller == OFF
        wake = self._wake(settings.plant)
        # What can be refused is, before the ECU that runs may be the one that is powered on.
        check_sensors(self._bundle, wake.layout)
        run = LiveRun(
            number=self._runs + 1,
            bundle=self._bundle,
            config=self._config,
            wake=wake,
            ecu=self._ecu(CONTROLLERS[0] if is_off else settings.controller, settings, powered_on=True),
            seed=self._seed,
            lead_in=self._lead_in,
            kept=self._kept,
        )
        run.set_disturbances(settings.disturbances)
        if is_off:
            run.cut_supply()
        run.request.waits = self._automatic
        self._run, self._runs = run, run.number
        self._settings = replace(settings, enable=False)
        self._seen = FIRST_SEEN
        self._rows = []
        self._ticks.clear()
        self._events.new_run()
        self._hello_due = self._settings_due = True
        self._now_due = False

    def _ecu(self, controller: str, settings: LiveSettings, *, powered_on: bool = False) -> LoopEcu:
        """The ECU with the weights of these settings; it may be the one that runs."""
        if controller not in self._made:
            made = self._make_ecu(controller)
            self._made[controller] = made, made.ecu.state
        ecu, at_first = self._made[controller]
        ecu.ecu.calibrate(self._own if settings.weights is None else replace(self._own, weights=settings.weights))
        if powered_on:
            ecu.ecu.restore(at_first)
        return ecu

    def _check_choices(self, settings: LiveSettings) -> None:
        """Raises ConfigError for one that is not to be had here."""
        for name, choices in self._choices.items():
            wanted = getattr(settings, name)
            found = next((choice for choice in choices if choice["name"] == wanted), None)
            if found is None:
                raise ConfigError(f"{name} {wanted!r} cannot be chosen here")
            if found["missing"]:
                raise ConfigError(f"{name} {wanted!r}: {found['missing']}")

    # What is new.

    def _present(self, latest: LivePeriod) -> list[LiveMessage | bytes]:
        run = self._run
        out: list[LiveMessage | bytes] = [
            present.now(
                run,
                latest,
                self._seen,
                fps=self._fps(),
                paused=self._paused,
                losses=self._config.ecu.loss_window,
            )
        ]
        if latest.k % _SELDOM == 0 or self._paused:
            out.append(
                run.bus_table.message(
                    run.number,
                    pressures=run.state.pressures,
                    commands=run.node.command_stream,
                    nodes=run.wired.errors(),
                )
            )
        if run.picture is not None:
            out.append(pack_field(run.picture))
        return out

    def _fps(self) -> float:
        ticks = self._ticks
        passed = float(ticks[-1] - ticks[0]) if len(ticks) > 1 else 0.0
        return (len(ticks) - 1) / passed if passed > 0.0 else 0.0

    def _note(self, kind: str, text: str) -> None:
        run = self._run
        t = run.k * self._config.flow.control_period
        self._events.add(kind, text, time_s=run.time_s(run.k), t=t)
