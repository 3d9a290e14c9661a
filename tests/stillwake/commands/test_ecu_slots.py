"""The folder of an ECU that can be flashed: made once and shown, and what `ecu` refuses to run of it."""

import json
from pathlib import Path

import pytest

from contract.shipped import BUNDLE

PROVISION = "ecu provision ecu --root root/release.pub --keys keys.list --hardware bench --serial 42"


@pytest.fixture
def good(cli, short_release, tmp_path, monkeypatch):
    """Calls a command that works, in a folder with a maker's keys and a release."""
    monkeypatch.chdir(tmp_path)

    def call(words: str) -> str:
        outcome = cli(*words.split())
        assert outcome.code == 0, outcome.err
        return str(outcome.out)

    for words in (
        "keygen root",
        "keygen maker",
        "keygen --secret access.key",
        "bundle keylist keys.list --key root/release.key --version 1 --allow maker/release.pub",
        f"bundle renew {short_release} first --name first --key maker/release.key --security-version 1",
    ):
        call(words)
    return call


def test_it_is_provisioned_once_and_shown(good, refused):
    assert "a key that is not in this ECU's list" in refused(*PROVISION.split(), "--bundle", BUNDLE)
    assert "ECU 42 (bench)" in good(f"{PROVISION} --bundle first")
    assert "exists already" in refused(*PROVISION.split())
    info = good("diagnose --slots ecu --json ecu.json")
    # What runs, the folder cannot know: it must not claim that nothing does.
    assert "confirmed, first" in info and "not in the folder" in info
    shown = json.loads(Path("ecu.json").read_text())["figures"]
    assert (shown["hardware"], shown["serial_number"]) == ("bench", "42")
    assert shown["store"]["slots"][0]["phase"] == "CONFIRMED"
    assert shown["store"]["key_list_version"] == 1


def test_what_cannot_run_is_one_line(good, all_refused):
    good(PROVISION)
    slots = "--slots ecu --access access.key"
    all_refused(
        "ecu --set bus.interface=udp_multicast --set bus.channel=239.77.0.1",
        {
            "--slots ecu": "--slots: needs --access; `stillwake keygen --secret` makes a key",
            "--access access.key": "--access: needs --slots or --mcu",
            "--hardware x": "--hardware: needs --slots or --mcu",
            "--slots none --access access.key": "none: not a folder of an ECU",
            "--slots ecu --access none.key": "none.key",
            f"first {slots}": "BUNDLE: --slots runs the release in its folder",
            f"{slots} --trust x": "--trust: --slots runs",
            "--mcu f.bin --root r --access a": "--mcu: needs --library; `stillwake export --c` writes one",
            f"{slots} --mcu f.bin": "--slots: --mcu runs a firmware",
            f"{slots} --set mpc.weights.lift=0.1": "does not use it",
        },
    )
