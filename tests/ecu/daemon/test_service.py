"""The whole ECU in a thread of this process, on a `virtual` bus, with a vehicle opposite."""

import json
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import count
from pathlib import Path
from threading import Event, Thread

import can
import numpy as np
import pytest

from can_bridge.bus.backends.python_can import PythonCanBus
from can_bridge.secoc.key import KEY_LENGTH, read_key, write_key
from can_bridge.secoc.securing import Authentication
from can_bridge.wire.message_sets import FD
from contract.config.tree import Config
from contract.config.vehicle import BusConfig, EcuConfig
from contract.errors import BundleError, BusError, ConfigError
from contract.release import bundle as bundles
from contract.release.checks import Bundle
from contract.runtime.onnx_session import OnnxController
from ecu.daemon.process import ProcessOptions, freshness_file, serve
from ecu.daemon.reporter import Counters
from ecu.real_time.privileges import Wanted
from tests.ecu.daemon.driving import PATIENCE_S, Vehicle

CHANNELS = count()
PLAIN = Wanted(priority=0, lock_memory=False, without_collector=False)
"""A test process keeps what it is; privileges have tests of their own."""


@pytest.fixture
def release(short_release: Path) -> Bundle:
    return bundles.load(short_release)


@pytest.fixture
def config() -> Config:
    # More misses than the window has steps: late steps, of which a busy machine has many, never latch.
    ecu = EcuConfig(deadline_misses=11)
    return Config(bus=BusConfig(interface="virtual", channel=f"service-{next(CHANNELS)}"), ecu=ecu)


def run(release: Bundle, config: Config, *, is_stopped, **options) -> Counters:
    controller, wanted = OnnxController.of(release), ProcessOptions(wanted=PLAIN, environment={}, **options)
    return serve(release, controller, config, wanted, is_stopped=is_stopped, write=print, signature="unsigned")


@contextmanager
def running(release: Bundle, config: Config, **options) -> Iterator[tuple[Event, list[Counters]]]:
    stop, ended = Event(), list[Counters]()

    def work() -> None:
        ended.append(run(release, config, is_stopped=stop.is_set, **options))

    thread = Thread(target=work)
    thread.start()
    try:
        yield stop, ended
    finally:
        stop.set()
        thread.join(PATIENCE_S)
    assert ended, "it did not end by itself"


def test_from_power_on_to_control_and_off_again(release, config, tmp_path):
    """Also as its file of frames has it; `tests/stillwake/commands/test_ecu.py` has the log and the other files."""
    with PythonCanBus.open(config.bus) as bus:
        vehicle = Vehicle(config, bus)
        with running(release, config, frames=tmp_path / "ecu.mf4") as (stop, ended):
            vehicle.until(lambda: len(vehicle.commands) > 10, request=True)
            # The request stood when it was switched on: that is no edge.
            assert {command.enable for command in vehicle.commands} == {False}
            vehicle.into_control()
            stop.set()
            vehicle.until(lambda: ended, request=True)
        vehicle.period(request=True)
        assert [(c.enable, c.flow_m2_per_s) for c in vehicle.commands[-3:]] == [(False, 0.0)] * 3
        assert vehicle.action == 0.0
    with can.MF4Reader(tmp_path / "ecu.mf4") as read:
        frames = [(one.arbitration_id, one.is_rx, bytes(one.data)) for one in read]
    assert {(frame_id, is_rx) for frame_id, is_rx, _ in frames} == {(0x120, True), (0x130, False), (0x140, False)}
    flows = [FD.command.parse(data) for frame_id, _, data in frames if frame_id == 0x130]
    assert [one.flow_m2_per_s for one in flows if one] == [one.flow_m2_per_s for one in vehicle.commands]


@pytest.mark.slow  # freshness values are looked at once a second
def test_with_a_key_a_restart_is_accepted_and_a_lost_file_is_not(release, config, tmp_path):
    key, freshness = tmp_path / "key", tmp_path / "state" / "freshness.json"
    write_key(key, secrets.token_bytes(KEY_LENGTH))
    config = replace(config, bus=replace(config.bus, key=str(key)))
    with PythonCanBus.open(config.bus) as bus:
        vehicle = Vehicle(config, bus, Authentication(key=read_key(key), trip=5))
        for trip in (1, 2):
            with running(release, config, freshness=freshness):
                vehicle.into_control()
                # A second look at the counters, in which the vehicle's power cycle is kept.
                vehicle.until(lambda: "290" in json.loads(freshness.read_text())["heard"], request=True)
            kept = json.loads(freshness.read_text())
            assert (kept["trip"], kept["heard"]["290"] >> 32) == (trip, 5)
        assert vehicle.node.frames_not_authentic == 0
        freshness.unlink()
        with running(release, config, freshness=freshness):
            vehicle.until(lambda: vehicle.node.frames_not_authentic > 20, request=True)
            assert vehicle.action == 0.0


def test_a_key_needs_a_place_for_what_outlives_a_restart():
    with pytest.raises(ConfigError, match="--freshness FILE"):
        freshness_file(ProcessOptions(environment={}))
    state = {"STATE_DIRECTORY": "/a:/b"}
    assert freshness_file(ProcessOptions(environment=state)) == Path("/a/freshness.json")
    assert freshness_file(ProcessOptions(freshness=Path("x"), environment=state)) == Path("x")


def test_what_cannot_run_is_refused_before_a_frame_is_sent(release, config):
    with PythonCanBus.open(config.bus) as bus:
        for change, error, words in (
            ({"bus": BusConfig()}, BusError, "in virtual time, without real devices"),
            ({"bus": BusConfig(interface="socketcan", channel="no-such0")}, BusError, "socketcan 'no-such0'"),
            ({"flow": replace(Config().flow, control_period=0.1)}, BundleError, "control period 0.2, but"),
            ({"ecu": EcuConfig(step_offset_ms=25.0)}, ConfigError, "ecu.step_offset_ms = 25"),
        ):
            with pytest.raises(error, match=words):
                run(release, replace(config, **change), is_stopped=lambda: True)
            assert bus.receive_all() == []


def test_whatever_ends_it_the_jets_are_shut(release, config):
    """Even a fault of its own, which no test knows of: here the looking for a stop fails."""
    looks = count()

    def broken() -> bool:
        if next(looks) == 5:
            raise RuntimeError("a fault of ours")
        return False

    with PythonCanBus.open(config.bus) as bus:
        vehicle = Vehicle(config, bus)
        with pytest.raises(RuntimeError, match="a fault of ours"):
            run(release, config, is_stopped=broken)
        vehicle.period(request=True)
        assert [command.enable for command in vehicle.commands] == [False] * 8


def test_onnx_runtime_has_no_thread_that_could_spin(release):
    def threads() -> set[str]:
        return set(os.listdir("/proc/self/task"))

    controller = OnnxController.of(release)
    before = threads()
    window, plan, free = (np.zeros(release.manifest.sizes.shapes()[name]) for name in ("window", "plan", "free"))
    another = OnnxController.of(release)
    for _ in range(10):
        for one in (controller, another):
            one.control_step(window, plan, free)
    # A pool of threads would have come with the second session; some of another test may have gone.
    assert threads() <= before
