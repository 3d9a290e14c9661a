"""`stillwake flash` as a user calls it: each way to end badly has its status and one line."""

import os
import sys
from dataclasses import replace
from itertools import count

import pytest

from can_bridge.secoc.key import write_key
from can_bridge.tester import asking, messages
from can_bridge.uds.services import Did
from contract.config.vehicle import BusConfig
from contract.errors import BusError
from contract.release import bundle
from contract.shipped import BUNDLE
from stillwake.console.progress import Report
from tests.can_bridge.flashing.releases import RELEASE, SECOND, keys, provisioned
from tests.can_bridge.flashing.store_ecu import SECRET, VALUES, StoreEcu
from tests.can_bridge.tester.ecus import SHIPPED, EcuToFlash
from tests.can_bridge.tester.served import served
from tests.stillwake.commands.test_bundle import image_of as unsigned_image

NUMBERS = count()


@pytest.fixture
def ecu() -> EcuToFlash:
    return EcuToFlash()


@pytest.fixture
def bus() -> BusConfig:
    return BusConfig(interface="virtual", channel=f"statuses-{os.getpid()}-{next(NUMBERS)}")


@pytest.fixture
def to(bus, tmp_path):
    """The words that name the bus and its ECU's key."""
    write_key(tmp_path / "access.key", SECRET)
    return ("--bus", f"virtual:{bus.channel}", "--access", tmp_path / "access.key")


@pytest.fixture
def call(cli, to):
    return lambda *options, release=BUNDLE: cli("flash", release, *to, *options)


@pytest.fixture
def flash(call, ecu, bus):
    def flash(*options, **others):
        ecu.power_on()
        with served(ecu, bus):
            return call(*options, **others)

    return flash


def ends(outcome, status: int, words: str) -> None:
    assert (outcome.code, outcome.err.count("\n")) == (status, 1), outcome.err
    assert words in outcome.err
    assert outcome.err.startswith("error: ")


@pytest.mark.slow
def test_a_release_is_flashed_and_then_left_alone(flash, ecu):
    name = bundle.load(BUNDLE).manifest.name
    outcome = flash("--dry-run")
    assert outcome.code == 0
    for words in ("no check failed", "20 ms", "confirmed old"):
        assert words in outcome.out
    assert ecu.memory.written == 0
    outcome = flash("--no-confirm")
    assert (outcome.code, f"{name} runs on trial, 2 boots left" in outcome.out) == (0, True)
    for words in ("runs, and is confirmed", "already runs and is confirmed: nothing was done"):
        outcome = flash()
        assert (outcome.code, outcome.err, f"{name} {words}" in outcome.out) == (0, "", True)


def test_each_error_has_the_status_of_its_remedy(call, monkeypatch):
    """`tests/can_bridge/tester` brings each about; here it is silence."""
    statuses = {"NoAnswer": 3, "Lost": 3, "Access": 4, "NotNow": 5, "WrongRelease": 6, "WrongKeys": 6}
    statuses |= {"ImageRefused": 6, "Refused": 7, "NotPassed": 8}
    assert {name: getattr(messages, f"{name}Error").status for name in statuses} == statuses
    monkeypatch.setattr(asking, "P2_S", 0.01)
    monkeypatch.setattr("can_bridge.tester.sequence.THERE_S", 0.05)
    ends(call(), 3, "check its power, that it runs with --slots, and that interface, channel, bus.frames and")


def test_what_the_ecu_would_refuse_is_not_sent(flash, ecu, tmp_path):
    shipped = bundle.load(BUNDLE)
    for name, key, changes, words in (
        ("unsigned", None, {}, "is not signed"),
        ("old", RELEASE, {"security_version": 0}, "has security version 0, but the ECU accepts 1 or greater"),
        ("other", RELEASE, {"hardware": "other"}, "is for hardware other, but the ECU has bench"),
    ):
        bundle.write(tmp_path / name, replace(shipped.manifest, name=name, **changes), shipped.files, key)
        outcome = flash(release=tmp_path / name)
        ends(outcome, 6, words)
        assert "nothing was written" in outcome.err
    for did, value, words in (
        (Did.DBC_SHA256, bytes(32), "is for the stillwake.dbc"),
        (Did.PERIOD_NS, (10_000_000).to_bytes(8, "big"), "has a control period of 20 ms, but the ECU has 10 ms"),
    ):
        ecu.values |= VALUES | {did: value}
        ends(flash(), 6, words)
    ecu.values |= VALUES
    ecu.memory.capacity = 50_000
    ends(flash(), 6, f"has {len(SHIPPED)} bytes, but the ECU has room for 50000")
    assert ecu.routines == []
    ecu.memory.capacity, ecu.is_wanted = 200_000, True
    ends(flash(), 5, "its jets are enabled or the vehicle asks for control")
    assert ecu.memory.written == 0
    ecu.is_wanted = False
    write_key(tmp_path / "wrong.key", bytes([7] * 16))
    ends(flash("--access", tmp_path / "wrong.key"), 4, "it must be the ECU's")
    assert ecu.runs == "old"


@pytest.mark.slow
def test_the_same_command_goes_on_behind_its_key_list(call, bus, tmp_path):
    (tmp_path / "keys.list").write_bytes(keys(3, RELEASE, SECOND))
    memory = provisioned()
    for had in (1, 3):
        # The project's key is in neither list; a reset between both calls makes the ECU forget what a tester sent.
        with served(StoreEcu(lambda: memory), bus):
            outcome = call("--keys", tmp_path / "keys.list")
        assert f"the ECU has key list 3, and had {had}\n" in outcome.out and outcome.code == 6
        assert "is signed by a key that is not in this ECU's list" in outcome.err


@pytest.mark.slow
def test_ctrl_c_leaves_what_was_sent(flash, ecu, monkeypatch):
    def stopped(_report, _task, done, *_more):
        if done > 50_000:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Report, "__call__", stopped)
        outcome = flash()
    assert outcome.code == 130
    assert outcome.err == "stopped; the ECU keeps the received part; the same command continues there\n"
    assert ecu.runs == "old"
    assert flash().code == 0
    assert ecu.memory.written == len(SHIPPED)


def test_what_cannot_begin(call, flash, all_refused, bus, monkeypatch):
    must_be = "must be INTERFACE:CHANNEL"
    words = ("flash", BUNDLE, "--bus", f"virtual:{bus.channel}")
    rows = {
        "--bus can0": f"--bus can0: {must_be}",
        "--bus virtual:": must_be,
        "--bus virtual:x --set bus.channel=y": "already sets bus.channel; leave out --set bus.channel",
        "--bus simulated:x": "bus.interface = simulated: it runs in virtual time",
        "--set ecu.hold_periods=2": "`flash` does not use it",
        "--access missing.key": "missing.key",
        "--trust missing.pub": "missing.pub",
    }
    all_refused((*words, "--access", "access.key"), rows)
    all_refused(words, {"": "--access: must name the ECU's key file", "--dry-run --keys k": "--access: must name"})
    all_refused(
        "flash",
        {"": "name the bundle or image", "--keys k --dry-run --access x": "--keys: the key list is written"}
        | dict.fromkeys((f"--keys k --access x {one}" for one in ("--trust t", "--no-confirm")), "apply to a release"),
    )

    def fails(*_arguments, **_named):
        raise BusError("the adapter was unplugged")

    with monkeypatch.context() as patch:
        patch.setattr("can_bridge.tester.transport.BusConnection.specific_send", fails)
        ends(flash(), 1, "the adapter was unplugged")
    for name in [name for name in sys.modules if name.partition(".")[0] == "udsoncan"]:
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.delitem(sys.modules, "can_bridge.tester.transport", raising=False)
    ends(call(), 1, "pip install '.[flash]' in a checkout")


def test_a_newer_key_list_is_taken_and_nothing_else(cli, refused, bus, to, tmp_path):
    memory, path = provisioned(), tmp_path / "keys.list"
    ecu, call = StoreEcu(lambda: memory), ("flash", "--keys", path, *to)
    with served(ecu, bus):
        path.write_bytes(keys(3, RELEASE, SECOND))
        (tmp_path / "a.swi").write_bytes(unsigned_image())
        assert "none" in refused(*call, "none")
        assert "must be signed by key" in refused(*call, tmp_path / "a.swi", "--trust", "project")
        assert cli(*call).out == "the ECU has key list 3, and had 1\n"
        # An older one, one without the key of the confirmed release, one of another root key.
        for raw in (keys(2, RELEASE), keys(4, SECOND), keys(5)[:-1]):
            path.write_bytes(raw)
            assert "a version above 3" in refused(*call, status=6)
    assert ecu.store.keys is not None and ecu.store.keys.version == 3
    for raw in (b"", bytes(4093)):
        path.write_bytes(raw)
        assert "1 to 4092 bytes" in refused(*call)
    assert "No such file" in refused("flash", "--keys", tmp_path / "none", *to)
