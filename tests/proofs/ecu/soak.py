"""An hour of virtual time through the whole loop, on a bus that loses, damages and doubles frames: what adds up?

    python -m tests.proofs.ecu soak --hours 1 --json results/soak.json

ECU, vehicle and simulated bus are those of `stillwake run`; the plant replays recorded pressures for ever, because the
wake would take hours. The bus carries other nodes' traffic. Seeded faults move every counter, and what each has done is
known. Vehicle and driver ask for control, end it now and then, and re-arm the ECU after each latched fault. It fails
with status 1 if memory grows, a counter differs from what was counted from the frames (`witness.py`), a frame is
gone that no fault took, or virtual time drifts.
"""

import time
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import replace
from math import isnan
from pathlib import Path
from random import Random
from resource import getpagesize
from typing import Annotated, Any, Final, NamedTuple

import typer

from can_bridge.bus.faults.content import FlipBits
from can_bridge.bus.faults.loss import BurstLoss, Drop, Duplicate
from can_bridge.bus.faults.wrapping import wrap
from can_bridge.bus.interface import BusState
from can_bridge.bus.simulated.background_node import BackgroundNode
from can_bridge.bus.simulated.medium import SimulatedBus
from can_bridge.timing.background import background
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import message_set
from can_bridge.wire.message_specs import ECU_STATUS, JET_COMMAND, PRESSURE
from can_bridge.wire.messages import Mode
from contract.config.loading import load_config
from contract.config.tree import Config
from contract.controller.interface import Controller
from contract.errors import ConfigError
from contract.recording.dataset import read
from contract.release.checks import Bundle
from contract.runtime.onnx_session import OnnxController
from contract.shipped import recording
from firmware_sim.bench.vehicle_node import VehicleNode
from firmware_sim.bench.virtual_loop import BusPorts, VirtualLoop
from firmware_sim.ecu.ecu import Ecu
from stillwake.parts.releases import open_release
from tests.proofs.command_line import JsonFile, console, report, track
from tests.proofs.ecu.replay import ReplayedPlant
from tests.proofs.ecu.witness import COUNTERS, Passed, Witness

EPISODE: Final = "chirp_0"
"""An episode of the shipped recording: 10,000 periods that no model was fitted to."""
MOST_GROWTH_MB: Final = 4.0
"""Growth of resident memory from a tenth of the time to its end: 25 bytes kept in each of an hour's periods would
show, and what the allocators of Python and ONNX Runtime move to and fro is less."""
_SETTINGS: Final = ("bus.background.load=0.3", "ecu.compute_time_ms=12")
"""With 12 ms of computing, a step that waited in vain for pressures makes the ECU skip the next one: it overruns."""
_LOW: Final = 10
"""Periods without a request after a latched fault: more than the ECU wants good frames before the edge."""
_STANDBY_EVERY: Final = 3000
_STANDBY: Final = 100
"""Periods: in each minute control is requested but for its last 2 s."""
_BUS_OFF_EVERY_NS: Final = 60_000_000_000
_BUS_OFF_NS: Final = 20_000_000
_WIRE_ERROR: Final = 0.01
"""Share of all frames that are destroyed on the wire and sent again."""
_BROKEN_BIT: Final = 60
"""Behind arbitration, so that it is the sender's error, and before the end of any frame here."""


class Soaked(NamedTuple):
    """The figures as they are written, and the checks that did not hold, a line each."""

    figures: Mapping[str, Any]
    failures: tuple[str, ...]


def main(
    json_file: JsonFile = None,
    hours: Annotated[float | None, typer.Option(help="Virtual time; default: 1.", min=0.01)] = None,
    minutes: Annotated[float | None, typer.Option(help="Virtual time instead, for a look.", min=0.5)] = None,
    seed: Annotated[int, typer.Option(help="Of the faults.", min=0)] = 0,
) -> None:
    """Run the loop, check what adds up, and print it; status 1 if anything does not."""
    if hours is not None and minutes is not None:
        raise ConfigError("--hours and --minutes exclude each other: give one")
    release = open_release(None, None)
    config = settings_of(release)
    duration_s = 60.0 * minutes if minutes is not None else 3600.0 * (1.0 if hours is None else hours)
    controller = OnnxController.of(release)
    controller.warm_up(1)
    periods = round(duration_s * 1e9 / config.period_ns)
    soaked = soak(release, controller, config, periods=periods, seed=seed)
    report(
        json_file,
        "soak",
        soaked.figures,
        packages=("stillwake", "numpy", "onnxruntime", "cantools", "autosar-e2e"),
        seed=seed,
        controller=controller.description,
        digest=release.digest,
        plant=f"{EPISODE} of the shipped recording, replayed",
        settings=list(_SETTINGS),
    )
    for failure in soaked.failures:
        console.print(f"FAILED: {failure}", style="bold red", soft_wrap=True)
    raise typer.Exit(int(bool(soaked.failures)))


def settings_of(release: Bundle) -> Config:
    """The vehicle of this measurement, with the release's optimiser."""
    config = load_config(None, list(_SETTINGS))
    return replace(config, mpc=release.manifest.mpc)


def soak(
    release: Bundle,
    controller: Controller,
    config: Config,
    *,
    periods: int,
    seed: int,
    most_growth_mb: float = MOST_GROWTH_MB,
) -> Soaked:
    """Run so many control periods of an ECU, with the faults of a seed; resident memory may grow by so many MB."""
    loop = _Loop(release, controller, config, seed)
    rss_mb: list[float] = []
    began = time.monotonic()
    for k in track(range(periods), "soak", "periods"):
        if k == periods // 10:
            rss_mb.append(resident_mb())
        loop.period(k)
    rss_mb.append(resident_mb())
    figures = {
        "periods": periods,
        "virtual_hours": periods * config.period_ns / 3.6e12,
        "took_minutes": (time.monotonic() - began) / 60.0,
        **loop.figures(periods),
        "rss_mb_at_a_tenth": rss_mb[0],
        "rss_mb_at_the_end": rss_mb[1],
        "rss_growth_mb": rss_mb[1] - rss_mb[0],
    }
    return Soaked(figures, tuple(_failures(figures, loop.witness, most_growth_mb)))


def resident_mb() -> float:
    """Resident memory of this process, from /proc."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * getpagesize() / 2**20


class _Loop:
    """Both nodes, the bus between them and its faults."""

    def __init__(self, release: Bundle, controller: Controller, config: Config, seed: int) -> None:
        dataset = read(recording())
        (episode,) = (item for item in dataset.episodes if item.name == EPISODE)
        self._config, self._wire_errors = config, _WireErrors(seed)
        self._on_wire: Counter[int] = Counter()
        self._unheard = self._in_control = self._faults = 0
        self._low_until, self._mode = 1, Mode.OFF
        self._bus = bus = SimulatedBus(config.bus, self._on_the_wire, corrupts=self._wire_errors)
        self._ports = {name: bus.port(name) for name in ("vehicle", "ECU", "background")}
        ours = [spec.frame_id for spec in message_set(config.bus).specs]
        BackgroundNode(
            bus, self._ports["background"], background(config.bus.background, config.bus, ours).messages, seed
        )
        pressures, commands = (PRESSURE.frame_id,), (JET_COMMAND.frame_id,)
        # Of the pressures some 3 % are lost and 1 % damaged behind CAN's own check; two fifths come twice.
        at_ecu = [
            Drop(probability=0.02, at="receive", frame_ids=pressures),
            BurstLoss(loss=0.01, mean_burst=3.0, at="receive", frame_ids=pressures),
            Duplicate(probability=0.4, at="receive", frame_ids=pressures),
            FlipBits(probability=0.01, at="receive", frame_ids=pressures),
        ]
        at_vehicle = [Drop(probability=0.02, at="receive", frame_ids=commands)]
        self._passed = {"vehicle": Passed(self._ports["vehicle"]), "ECU": Passed(self._ports["ECU"])}
        self._at_vehicle = wrap(self._passed["vehicle"], at_vehicle, lambda: bus.now_ns, seed=2 * seed)
        self._at_ecu = wrap(self._passed["ECU"], at_ecu, lambda: bus.now_ns, seed=2 * seed + 1)
        self._for_vehicle = Passed(self._at_vehicle)
        self.witness = Witness(self._at_ecu, lambda: bus.now_ns, max_delta=config.bus.e2e.max_delta)
        self._for_ecu = Passed(self.witness)
        node = VehicleNode(release.manifest.sensors, config, dataset.layout)
        self._plant = ReplayedPlant(episode.series, config.flow.control_period)
        connected = BusPorts(vehicle=self._for_vehicle, ecu=self._for_ecu, ecu_health=self._ports["ECU"].health)
        ecu = Ecu(release, controller, config)
        self._loop = VirtualLoop(self._plant, node, ecu, bus, connected, config)

    def period(self, k: int) -> None:
        """The k-th one; control is requested but for a pause a minute and after a latched fault."""
        pause = k % _STANDBY_EVERY >= _STANDBY_EVERY - _STANDBY
        row = self._loop.period(enable_request=k >= self._low_until and not pause)
        self.witness.skipped += isnan(row.step_ms)
        self._in_control += row.mode == Mode.CONTROL
        if row.mode == Mode.FAULT and k >= self._low_until + _LOW:
            self._low_until = k + _LOW
        self._faults += row.mode == Mode.FAULT != self._mode
        self._mode = Mode(row.mode)

    def figures(self, periods: int) -> dict[str, Any]:
        """What adds up after so many periods; unaccounted frames are those that no fault took."""
        pressure, command, status = PRESSURE.frame_id, JET_COMMAND.frame_id, ECU_STATUS.frame_id
        vehicle, ecu = self._passed["vehicle"], self._passed["ECU"]
        drops, bursts, copies, flips = (one.acted for one in self._at_ecu.injectors)
        (lost_commands,) = (one.acted for one in self._at_vehicle.injectors)
        ours, on_wire = (pressure, command, status), self._on_wire
        sent = vehicle.sent[pressure] + ecu.sent[command] + ecu.sent[status]
        discarded = sum(self._ports[name].discarded for name in ("vehicle", "ECU"))
        # Each stage hands on what the one before gave it, but for what is known to be taken or added there: onto the
        # bus, to the ECU, to the vehicle, through the faults of either.
        stages = (
            sent - sum(on_wire[frame_id] + self._bus.under_way(frame_id) for frame_id in ours) - discarded,
            on_wire[pressure] - self._unheard - ecu.received[pressure],
            on_wire[command] - vehicle.received[command],
            ecu.received[pressure] - drops - bursts + copies - self._for_ecu.received[pressure],
            vehicle.received[command] - lost_commands - self._for_vehicle.received[command],
        )
        latest, activity = self.witness.latest, self._bus.activity()
        return {
            "frames_on_bus": activity.frames,
            "bus_load": activity.load,
            "error_frames": activity.error_frames,
            "frames_sent": sent,
            "frames_lost_to_faults": drops + bursts + lost_commands,
            "frames_lost_to_bus_off": discarded + self._unheard,
            "frames_doubled": copies,
            "frames_damaged": flips,
            "frames_unaccounted": sum(map(abs, stages)),
            "statuses_compared": self.witness.statuses,
            "counter_mismatches": self.witness.mismatches,
            **{f"counted_{key}": self.witness.counted[name] for key, name in COUNTERS.items()},
            **{f"said_{key}": int(latest[name]) for key, name in COUNTERS.items()},
            "said_bus_off": int(latest["BusOff"]),
            "counted_bus_off": self._wire_errors.bus_off,
            "periods_in_control": self._in_control,
            "faults_latched": self._faults,
            "drift_ns": self._bus.now_ns + 1 - periods * self._config.period_ns,
            "plant_periods": self._plant.periods,
        }

    def _on_the_wire(self, frame: Frame) -> None:
        if frame.is_extended:
            return
        self._on_wire[frame.frame_id] += 1
        self._wire_errors.went_out(frame)
        if frame.frame_id == PRESSURE.frame_id and self._ports["ECU"].health().state is BusState.BUS_OFF:
            self._unheard += 1


class _WireErrors:
    """What destroys frames on the wire: one in a hundred, and once a minute all of the ECU's until it is bus-off.

    Keeps the ECU's transmit error counter by the rules of ISO 11898-1: 8 more for each frame destroyed, 1 less for each
    that went out, bus-off from 256 on, and then from 0 again.

    Attributes:
        bus_off: how often the ECU went bus-off by that count.
    """

    def __init__(self, seed: int) -> None:
        self._random = Random(f"{seed} wire")
        self._errors = self.bus_off = 0

    def __call__(self, frame: Frame, sender: str, begin_ns: int) -> int | None:
        in_span = begin_ns % _BUS_OFF_EVERY_NS < _BUS_OFF_NS and begin_ns > _BUS_OFF_EVERY_NS // 2
        if not (self._random.random() < _WIRE_ERROR or (in_span and sender == "ECU")):
            return None
        if sender == "ECU":
            self._errors += 8
            if self._errors >= 256:
                self._errors, self.bus_off = 0, self.bus_off + 1
        return _BROKEN_BIT

    def went_out(self, frame: Frame) -> None:
        """A frame of any node."""
        if frame.frame_id in (JET_COMMAND.frame_id, ECU_STATUS.frame_id):
            self._errors = max(0, self._errors - 1)


def _failures(figures: Mapping[str, Any], witness: Witness, most_growth_mb: float) -> Iterable[str]:
    if witness.mismatches:
        yield f"{witness.mismatches} counters differ; {witness.first_mismatch}"
    if figures["frames_unaccounted"]:
        yield f"{figures['frames_unaccounted']} frames are gone or too many that no fault took or made"
    if figures["said_bus_off"] != min(figures["counted_bus_off"], 255):
        yield f"EcuStatus has {figures['said_bus_off']} times bus-off, must be {figures['counted_bus_off']}"
    for name in (*(f"counted_{key}" for key in COUNTERS), "counted_bus_off", "periods_in_control"):
        if not figures[name]:
            yield f"{name} is 0: the faults did not move it, so nothing is shown"
    if figures["drift_ns"]:
        yield f"virtual time is {figures['drift_ns']} ns off"
    if figures["plant_periods"] != figures["periods"]:
        yield f"the plant went {figures['plant_periods']} periods, must be {figures['periods']}"
    if not figures["rss_growth_mb"] <= most_growth_mb:
        yield f"memory grew by {figures['rss_growth_mb']:.1f} MB, at most {most_growth_mb:g} are rounding"
