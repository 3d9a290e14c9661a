"""A vehicle on a virtual bus in real time, with an ECU in a thread. Nothing here depends on how fast that is."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from can_bridge.bus.backends.python_can import PythonCanBus, ReceiveThread
from can_bridge.secoc.freshness_store import FreshnessStore
from can_bridge.secoc.key import read_key
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import message_set
from can_bridge.wire.messages import Mode
from contract.config.operating_point import OperatingPoint
from contract.config.tree import Config
from contract.config.vehicle import BusConfig
from contract.errors import ConfigError, PlantError
from contract.recording.dataset import Dataset
from ecu.ecu import Ecu
from ecu.real_time.privileges import Wanted
from ecu.real_time.stage_times import VehicleStage, load
from firmware_sim.bench.real_time.running import Course, run_vehicle
from firmware_sim.bench.real_time.vehicle_loop import Replay
from tests.ecu.conftest import RecordingController, make_bundle
from tests.firmware_sim.bench.harness import NAMES
from tests.firmware_sim.bench.real_time.test_vehicle_loop import episode, pressure_in

# A third of a truck's width has a third of its control period: 60 of them take 0.4 s.
POINT = OperatingPoint(width=2.5 / 3.0)
BUS = BusConfig(interface="virtual", channel="test-vehicle")
CONFIG = Config(operating_point=POINT, bus=BUS)
ORDINARY = Wanted(priority=0, lock_memory=False, without_collector=False)


@pytest.fixture
def replay() -> Replay:
    still = episode("still", "train", 50, 0.0)
    return Replay(Dataset(episodes=(replace(still, series={**still.series, "Cp": np.zeros_like(still.series["Cp"])}),)))


@contextmanager
def ecu_on(config: Config, ecu: Ecu) -> Iterator[list[Frame]]:
    """An ECU that answers each pressure frame at once; what it was sent."""
    seen: list[Frame] = []
    pressure = message_set(config.bus).pressure.spec

    with PythonCanBus.open(config.bus) as bus:

        def answer(frame: Frame) -> None:
            if pressure.names(frame):
                seen.append(frame)
                # In the ECU's own time every frame is on time: what is looked at is the vehicle.
                now_ns = len(seen) * config.period_ns
                for item in ecu.step(now_ns, [replace(frame, timestamp_ns=now_ns)]):
                    bus.send(item)

        with ReceiveThread(bus, answer) as thread:
            yield seen
            thread.check()


def course(**changes) -> Course:
    return Course(**{"periods": 60, "enable_after_s": 0.04, "wanted": ORDINARY, **changes})


@pytest.mark.slow
def test_a_run_from_the_first_frame_to_the_farewell(replay, tmp_path: Path) -> None:
    ecu = Ecu(make_bundle(operating_point=POINT), RecordingController(lambda i: 0.02), CONFIG)
    lines, shown, given = list[str](), list[int](), course(periods=160, stage_times=tmp_path / "times.npz")
    with ecu_on(CONFIG, ecu) as seen, PythonCanBus.open(BUS) as bus:
        figures = run_vehicle(
            bus, NAMES, replay, CONFIG, given, report=lines.append, progress=lambda found: shown.append(found.periods)
        )
    requests = [pressure_in(frame).enable_request for frame in seen]
    # Wanted from six periods of 6.7 ms on; withdrawn at the end.
    assert not any(requests[:6])
    assert requests[-3:] == [False, False, False]
    assert figures.periods == 160
    assert 0 < figures.commands + figures.misses < 160
    assert figures.modes[Mode.CONTROL] > 0
    assert figures.largest == pytest.approx(0.02, abs=1e-4)
    assert figures.as_dict()["modes"]["CONTROL"] == figures.modes[Mode.CONTROL]
    assert lines[0].startswith("real time: ")
    assert shown == [75, 150]
    assert len(load(tmp_path / "times.npz", VehicleStage)) == 160


def test_with_a_key_both_are_believed_and_the_power_cycles_are_counted(replay, tmp_path: Path) -> None:
    key = tmp_path / "bus.key"
    key.write_text("00112233445566778899aabbccddeeff\n", encoding="ascii")
    key.chmod(0o600)
    config = Config(operating_point=POINT, bus=replace(BUS, key=str(key)))
    begun = FreshnessStore(tmp_path / "ecu.json").begin(read_key(key))
    ecu = Ecu(make_bundle(operating_point=POINT), RecordingController(lambda i: 0.02), config, authentication=begun)
    for trip in (1, 2):
        with ecu_on(config, ecu), PythonCanBus.open(config.bus) as bus:
            figures = run_vehicle(bus, NAMES, replay, config, course(periods=30, freshness=tmp_path / "vehicle.json"))
        assert figures.commands > 0
        assert f'"trip": {trip}' in (tmp_path / "vehicle.json").read_text(encoding="utf-8")
    failing, fails = tmp_path / "failing.json", Mock(side_effect=PlantError("made up"))
    with ecu_on(config, ecu), PythonCanBus.open(config.bus) as bus, pytest.raises(PlantError, match="made up"):
        run_vehicle(bus, NAMES, replay, config, course(freshness=failing, periods=100), progress=fails)
    assert '"heard": {}' not in failing.read_text(encoding="utf-8")
    with PythonCanBus.open(config.bus) as bus, pytest.raises(ConfigError, match=r"bus\.key = .*: needs --freshness"):
        run_vehicle(bus, NAMES, replay, config, course())
