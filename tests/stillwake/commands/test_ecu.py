"""`stillwake ecu`: what it refuses and leaves behind; and the folder of an ECU that can be flashed, made and shown."""

import json
import socket
from configparser import RawConfigParser
from pathlib import Path

import pytest

from contract.shipped import BUNDLE
from ecu.real_time.privileges import PRIORITY
from ecu.real_time.stage_times import EcuStage, load

ROOT = Path(__file__).parents[3]
UDP = ("--set", "bus.interface=udp_multicast", "--set", "bus.channel=239.76.0.1")
PROVISION = "ecu provision ecu --root root/release.pub --keys keys.list --hardware bench --serial 42"


@pytest.mark.slow  # many calls
def test_what_cannot_run_is_one_line(all_refused, short_release):
    rows = {
        "": "bus.interface = simulated: it runs in virtual time, without real devices",
        "no-bundle --bus virtual:x": "no-bundle",
    }
    all_refused("ecu", rows)
    rows = {
        "--set bus.interface=can4711": "python-can does not know it",
        "--set flow.control_period=0.1": "was built for control period 0.2, but the vehicle has 0.1",
        "--set operating_point.speed=20": "was built for operating point",
        "--set ecu.step_offset_ms=20": "ecu.step_offset_ms = 20: must be shorter than the control period",
        "--set ecu.compute_time_ms=5": "--set ecu.compute_time_ms: `ecu` does not use it",
        "--freshness x": "--freshness: needs a key",
        "--set bus.key=none": "none",
        "--metrics /proc/x": "cannot write /proc/x",
        "--metrics x --stage-times x": "x is the same path as x, or lies in it",
        "--metrics bus.key --freshness x --set bus.key=bus.key": "bus.key is the same path as bus.key",
        "--library .": "library .: ",
    }
    all_refused(("ecu", short_release, *UDP), rows)


def test_the_examples_of_services_call_it_with_options_that_it_has(cli):
    known = cli("ecu", "--help").out
    for name, count in (("stillwake-ecu", 4), ("stillwake-ecu-slots", 5)):
        text = (ROOT / f"examples/systemd/{name}.service").read_text()
        unit = RawConfigParser(strict=False, comment_prefixes="#")
        unit.optionxform = str  # type: ignore[assignment,method-assign]  # names as they are
        unit.read_string(text.replace("\\\n", " "))
        service = unit["Service"]
        command = service["ExecStart"].split()
        assert command[1] == "ecu"
        options = [word for word in command if word.startswith("--")]
        assert len(options) == count, name
        assert all(option in known for option in options), name
        # What the daemon and its page rely on.
        assert (service["Type"], service["LimitRTPRIO"]) == ("notify", str(PRIORITY))
        assert "RestrictRealtime" not in service


def test_from_its_start_to_its_last_period(cli, short_release, tmp_path, monkeypatch):
    """`tests/ecu/daemon` has the process beside a vehicle, and `test_stops.py` its end by a signal."""
    metrics, stages = tmp_path / "ecu.prom", tmp_path / "ecu.npz"
    files = ("--metrics", metrics, "--stage-times", stages, "--log", "json", "--priority", 0)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        systemd.bind(str(tmp_path / "notify"))
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        done = cli("ecu", short_release, "--bus", "virtual:test-ecu", "--periods", 5, *files)
        systemd.settimeout(1.0)
        heard = list(iter(lambda: systemd.recv(4096), b"STOPPING=1"))
    assert any(said.startswith(b"READY=1") for said in heard)
    assert (done.code, done.out) == (0, "")
    events = [json.loads(line) for line in done.err.splitlines()]
    assert (events[0]["event"], events[0]["channel"]) == ("runs", "test-ecu")
    # On a busy machine the last line may be of periods that were left out.
    (steps,) = (event["steps"] for event in events if event["event"] == "stopped")
    assert f"stillwake_ecu_steps_total {steps}\n" in metrics.read_text()
    assert len(load(stages, EcuStage)) == steps >= 5
    # The socket is the test's; nothing half-written is left.
    assert sorted(path.name for path in tmp_path.iterdir()) == ["ecu.npz", "ecu.prom", "notify"]


@pytest.fixture
def office(printed, short_release, tmp_path, monkeypatch) -> None:
    """The test runs in a folder with a maker's keys and a release."""
    monkeypatch.chdir(tmp_path)
    for words in (
        "keygen root",
        "keygen maker",
        "keygen --secret access.key",
        "bundle keylist keys.list --key root/release.key --version 1 --allow maker/release.pub",
        f"bundle renew {short_release} first --name first --key maker/release.key --security-version 1",
    ):
        printed(*words.split())


@pytest.mark.usefixtures("office")
def test_it_is_provisioned_once_and_shown(printed, refused):
    assert "a key that is not in this ECU's list" in refused(*PROVISION.split(), "--bundle", BUNDLE)
    assert "ECU 42 (bench)" in printed(*PROVISION.split(), "--bundle", "first")
    assert "exists already" in refused(*PROVISION.split())
    info = printed("diagnose", "--slots", "ecu", "--json", "ecu.json")
    # What runs, the folder cannot know: it must not claim that nothing does.
    assert "confirmed, first" in info and "not in the folder" in info
    shown = json.loads(Path("ecu.json").read_text())["figures"]
    assert (shown["hardware"], shown["serial_number"]) == ("bench", "42")
    assert shown["store"]["slots"][0]["phase"] == "CONFIRMED"
    assert shown["store"]["key_list_version"] == 1


@pytest.mark.usefixtures("office")
def test_what_cannot_run_of_a_folder_is_one_line(printed, all_refused):
    printed(*PROVISION.split())
    slots = "--slots ecu --access access.key"
    rows = {
        "--slots ecu": "--slots: needs --access; `stillwake keygen --secret` makes a key",
        "--access access.key": "--access: needs --slots or --mcu",
        "--hardware x": "--hardware: needs --slots or --mcu",
        "--slots none --access access.key": "none: not a folder of an ECU",
        "--slots ecu --access none.key": "none.key",
        f"first {slots}": "BUNDLE: --slots runs the release in its folder",
        f"{slots} --trust x": "--trust: --slots runs",
        "--mcu f.bin --root r --access a": "--mcu: needs --library; `stillwake export --c` writes a library",
        f"{slots} --mcu f.bin": "--slots: --mcu runs a firmware",
        "--mcu f.bin --stage-times x.npz": "--stage-times: --mcu runs a firmware",
        "--mcu f.bin --freshness x": "--freshness: --mcu runs a firmware",
        "--mcu f.bin --spin 20": "--spin: --mcu runs a firmware",
        f"{slots} --set mpc.weights.lift=0.1": "`ecu --slots` does not use it",
    }
    all_refused("ecu --set bus.interface=udp_multicast --set bus.channel=239.77.0.1", rows)
