"""The live loop, without socket, process or thread: a caller runs it period by period, passes requests to it, and
fetches messages. With unchanged settings it computes the same rows as `firmware_sim.bench.simulation`."""

import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from math import inf
from typing import Any, ClassVar, Final

from contract.config.tree import Config
from contract.errors import ConfigError, StillwakeError
from contract.release.checks import Bundle
from contract.runtime.copies import NeverCopied
from ecu.calibrating import limits_of, release_calibration
from ecu.ecu_state import EcuState
from ecu.fit import check_sensors
from ecu.stepped import LoopEcu
from firmware_sim.bench.disturbances import Disturbances
from firmware_sim.bench.virtual_loop import check_bit_rates
from firmware_sim.live import present
from firmware_sim.live.loop.live_run import LivePeriod, LiveRun
from firmware_sim.live.loop.messages import KEPT_PERIODS, Choice, LiveAnswer, LiveMessage
from firmware_sim.live.loop.noticing import FIRST_SEEN, EventLog, noticed
from firmware_sim.live.settings import CONTROLLERS, LiveSettings, asked, changes
from wake.plant.protocol import LoopPlant

OFF: Final = "off"
"""Name of the choice in which the ECU has no supply."""
_PACE: Final = 50  # number of latest periods from which the periods per second of wall-clock time are measured
_SELDOM: Final = 5  # number of periods from one sent bus table to the next


class LiveSession(NeverCopied):
    """A loop and the settings of its viewers. `config` has the bundle's operating point and control period. `wake`
    returns a plant in its initial state by the plant's name. `ecu` returns an ECU that has just been powered on by the
    controller's name, and is called once for each name; `ahead` returns a function that prepares a slow ECU, or None.
    Control is requested after `lead_in`, in t_c, whatever `enable` is in the initial settings. `clock` is a wall clock
    in s. Raises StillwakeError if plant or ECU cannot be created, or do not fit each other, bundle or vehicle."""

    INSTEAD: ClassVar = "bus and nodes call each other; create another session, which gives the same result bit for bit"

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
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        check_bit_rates(config)
        self._bundle, self._config, self._wake = bundle, config, wake
        self._make_ecu, self._ahead = ecu, ahead
        self._own, self._limits = release_calibration(bundle, config), limits_of(bundle, config)
        self._made: dict[str, tuple[LoopEcu, EcuState]] = {}
        self._choices = {"controller": tuple(controllers), "plant": tuple(plants)}
        self._clock = clock
        self._lead_in = round(lead_in / config.flow.control_period)
        self._automatic, self._paused = True, False
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
        """Run one control period. A paused loop runs only a run's first period, because without this period a new
        viewer would see no state and could not end the pause. Raises StillwakeError if the flow diverges."""
        run = self._run
        if self._paused and run.latest is not None:
            return
        if run.request.begins(run.k):
            self._settings = replace(self._settings, enable=True)
            self._settings_due = True
            self._note("loop", "the lead-in is over: the vehicle requests control")
        latest = run.step()
        self._rows.append(latest)
        del self._rows[:-KEPT_PERIODS]
        self._ticks.append(self._clock())
        seen = run.seen()
        for kind, text in noticed(self._seen, seen):
            self._note(kind, text)
        self._seen = seen
        self._events.pass_to(run.time_s(run.k), latest.row.sample.t)
        self._now_due = True

    def before(self, request: object) -> Callable[[], None] | None:
        """Return a function, for a thread, that prepares the requested ECU; None if there is nothing to prepare."""
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
        """Apply a viewer's request, which may be any JSON value, between two periods."""
        try:
            note = self._do(*asked(request))
        except StillwakeError as error:
            return {"error": " ".join(str(error).split())}
        return {"note": note} if note else {}

    def messages(self) -> list[LiveMessage | bytes]:
        """Return the new messages since the last call."""
        run, out = self._run, list[LiveMessage | bytes]()
        if self._hello_due:
            out.append(present.hello(run, self._bundle, self._config, self._settings, choices=self._choices))
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

    def _do(self, action: str, value: Any) -> str:
        match action:
            case "set":
                self._apply(self._changed(value), enable=value.get("enable"))
            case "clear":
                return self._clear()
            case "power_cycle":
                if self._settings.controller == OFF:
                    raise ConfigError("power cycle: the ECU has no supply; choose a controller to start the ECU")
                self._run.power_on()
                self._note("set", "the ECU's supply is cut for a moment")
            case "pause":
                self._paused, self._now_due = value, True
                self._ticks.clear()
            case "restart":
                self._start(self._settings)
                self._note("set", "the plant starts again")
        return ""

    def _changed(self, given: dict[str, Any]) -> LiveSettings:
        return self._settings.changed(given, self._bundle.manifest.sensors, self._own, self._limits)

    def _apply(self, after: LiveSettings, *, enable: bool | None) -> None:
        """Apply new settings from the next period on, or raise StillwakeError and change nothing."""
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
        run = self._run
        if after.controller == OFF:
            if before.controller != OFF:
                run.cut_supply()
            return
        run.exchange(self._ecu(after.controller, after))
        if before.controller == OFF:
            run.power_on()

    def _clear(self) -> str:
        now = self._settings
        self._apply(LiveSettings(enable=now.enable, controller=now.controller, plant=now.plant), enable=None)
        text = "cleared"
        if self._run.state.sensors.set_aside is not None and not self._run.is_off:
            text += "; the ECU starts again, and uses all sensors again"
        if self._run.help():
            text += "; the request is withdrawn for a moment, since only a new request starts control"
        self._note("set", text)
        return text

    def _start(self, settings: LiveSettings) -> None:
        """Start a run from the plant's initial state, or raise StillwakeError and change nothing."""
        is_off = settings.controller == OFF
        wake = self._wake(settings.plant)
        # This check must come before `_ecu`, which may reset the running ECU.
        check_sensors(self._bundle, wake.layout)
        ecu = self._ecu(CONTROLLERS[0] if is_off else settings.controller, settings, powered_on=True)
        run = LiveRun(self._runs + 1, self._bundle, self._config, wake, ecu, lead_in=self._lead_in)
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
        """Return the ECU of this controller with these settings' weights; it may be the running ECU."""
        if controller not in self._made:
            made = self._make_ecu(controller)
            self._made[controller] = made, made.ecu.state
        ecu, at_first = self._made[controller]
        if powered_on:
            # A run's time begins at 0. Without this call, an emulated core would wait until the time reaches its clock.
            for made, _ in self._made.values():
                made.start_clock()
        ecu.ecu.calibrate(self._own if settings.weights is None else replace(self._own, weights=settings.weights))
        if powered_on:
            ecu.ecu.restore(at_first)
        return ecu

    def _check_choices(self, settings: LiveSettings) -> None:
        Disturbances.parse(settings.disturbances).check(self._config, self._bundle.manifest.sensors, duration_s=inf)
        for name, choices in self._choices.items():
            wanted = getattr(settings, name)
            found = next((choice for choice in choices if choice["name"] == wanted), None)
            if found is None:
                raise ConfigError(f"{name} {wanted!r} cannot be chosen here")
            if found["missing"]:
                raise ConfigError(f"{name} {wanted!r}: {found['missing']}")

    def _present(self, latest: LivePeriod) -> list[LiveMessage | bytes]:
        run, ticks = self._run, self._ticks
        passed = float(ticks[-1] - ticks[0]) if len(ticks) > 1 else 0.0
        fps = (len(ticks) - 1) / passed if passed > 0.0 else 0.0
        out: list[LiveMessage | bytes] = [present.now(run, latest, self._seen, fps=fps, paused=self._paused)]
        if latest.k % _SELDOM == 0 or self._paused:
            receivers = run.state.pressures, run.node.receiver.state
            out.append(run.bus_table.message(run.number, *receivers, run.wired.errors()))
        if run.picture is not None:
            out.append(run.picture)
        return out

    def _note(self, kind: str, text: str) -> None:
        run = self._run
        self._events.add(kind, text, time_s=run.time_s(run.k), t=run.k * self._config.flow.control_period)
