"""The page of a run: complete, and safe against what a bundle's author wrote into it; runs compared; their events."""

import base64
import hashlib
import json
import re
from dataclasses import replace
from pathlib import Path

import pytest
from PIL import Image

from can_bridge.wire.messages import Mode, Reason
from contract.errors import StillwakeError
from firmware_sim.runs import run_log
from firmware_sim.runs.metadata import InjectedFault, RunEcu
from firmware_sim.runs.run_log import RunFolder
from firmware_sim.runs.run_page import run_data as listing
from firmware_sim.runs.run_page.report import differing, figure_rows, names_of, write_picture, write_report
from firmware_sim.runs.run_page.run_data import MOST_EVENTS, disturbed, events

ONE_PIXEL = bytes.fromhex(
    "89504e470d0a1a0a0000000d4948445200000001000000010802000000907753de"
    "0000000c4944415408d763f8ffff3f0005fe02fea7350180000000000049454e44ae426082"
)


def written(log, path) -> RunFolder:
    folder = RunFolder(path)
    run_log.save(folder.series, log)
    folder.uncontrolled_picture.write_bytes(ONE_PIXEL)
    folder.controlled_picture.write_bytes(ONE_PIXEL)
    return folder


@pytest.fixture
def folder(shedding, tmp_path) -> RunFolder:
    return written(shedding(), tmp_path)


@pytest.mark.slow  # draws pages
def test_names_are_escaped_and_none_ends_the_data(folder):
    log = run_log.load(folder.series)
    sensors = (*log.metadata.sensors[1:], "</script><!--")
    script = "<script>alert('a')</script>"
    hostile = replace(log.metadata, controller=script, signer="<b>", plant='"><img src=x>', sensors=sensors)
    run_log.save(folder.series, replace(log, metadata=hostile))
    page = write_report(folder).read_text(encoding="utf-8")
    assert "&lt;script&gt;" in page
    assert "signed by key &lt;b&gt;" in page
    assert all(text not in page for text in ("<script>alert", "<b>", "src=x>", "<!--", "--picture"))
    data = re.search(r'<script type="application/json" id="run">(.*?)</script>', page, re.DOTALL)
    assert data is not None
    assert json.loads(data[1])["sensors"][-1] == "</script><!--"
    # Of scripts it runs its own alone. A folder of an earlier version has no recorded wake.
    scripts = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    policy = re.search(r'http-equiv="Content-Security-Policy" content="([^"]*)"', page)
    assert policy is not None and policy[1].startswith("default-src &#39;none&#39;;")
    hashes = [base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in scripts]
    assert re.findall(r"sha256-([^ ;]+)&#39;", policy[1]) == hashes
    assert '"wake":null' in page
    # The wake before and under control.
    assert page.count("data:image/png;base64,") == 2


@pytest.mark.slow  # draws pages
def test_a_faulted_run_has_a_red_box_before_anything_else_and_one_without_a_plan_has_a_page(shedding, folder):
    modes, reasons = ({2: value} for value in (Mode.FAULT, Reason.SENSOR_INVALID))
    run_log.save(folder.series, shedding(modes=modes, reasons=reasons))
    page = write_report(folder).read_text(encoding="utf-8")
    box = page.index('<p class="trouble" role="alert">ECU FAULT: SENSOR_INVALID at t = 12.4 t_c')
    assert box < page.index("<table>") < page.index('<caption class="trouble">ECU FAULT') < page.index("mean Cd (wall)")
    run_log.save(folder.series, shedding(modes=dict.fromkeys(range(100), Mode.OFF), skipped=range(100)))
    assert write_report(folder).is_file()


@pytest.mark.slow  # draws pages
def test_a_page_states_the_times_that_its_run_had(shedding, folder):
    log = shedding(ecu=RunEcu.of("mcu", 480.0, [10_000_000]))
    usual = "a control step takes 8 ms on any"
    assert usual in " ".join(write_report(folder).read_text(encoding="utf-8").split())
    config = replace(log.metadata.config, bus=replace(log.metadata.config.bus, frames="classic"))
    run_log.save(folder.series, replace(log, metadata=replace(log.metadata, config=config)))
    page = " ".join(write_report(folder).read_text(encoding="utf-8").split())
    assert usual not in page
    assert "takes the core's modelled cycles; frame times follow from the bits at 500 kbit/s.</p>" in page


@pytest.mark.slow  # draws pages
def test_a_picture_names_its_bundle_and_one_of_another_kind_is_refused(folder, tmp_path):
    for kind, start in (("png", b"\x89PNG"), ("pdf", b"%PDF")):
        write_picture(folder, tmp_path / f"run.{kind}")
        assert (tmp_path / f"run.{kind}").read_bytes().startswith(start)
    with Image.open(tmp_path / "run.png") as image:
        assert image.info["Description"] == "stillwake bundle " + "0123456789abcdef" * 4
    with pytest.raises(StillwakeError, match=r"x\.xyz: must be a file ending in \.png, \.pdf, \.svg"):
        write_picture(folder, tmp_path / "x.xyz")
    log = run_log.load(folder.series)
    run_log.save(folder.series, replace(log, enabled_at=len(log.series["t"])))
    write_picture(folder, tmp_path / "unrequested.svg")
    folder.controlled_picture.unlink()
    with pytest.raises(StillwakeError, match=r"vorticity_controlled\.png: No such file"):
        write_report(folder)


def test_names_are_as_long_as_it_takes():
    for paths, names in (("/x/a /x/b", "a b"), ("/x/new/run /x/old/run /x/old/other", "new/run old/run old/other")):
        assert names_of([Path(path) for path in paths.split()]) == names.split()


def test_differences_are_against_the_first_run(shedding):
    # Known means: Cd 1.1 without control, and as given under it.
    rows = dict(figure_rows([shedding(0.88), shedding(0.99), shedding(0.88, averages=False)]))
    assert rows["mean Cd (wall), controlled"] == [("0.8800", ""), ("0.9900", "+0.1100"), ("\N{EN DASH}", "")]
    assert rows["less wall drag / %"] == [("20.00", ""), ("10.00", "-10.00"), ("\N{EN DASH}", "")]
    assert rows["periods in control"] == [("100", ""), ("100", "="), ("100", "=")]


def test_only_what_is_not_the_same_is_listed(shedding):
    one = shedding()
    assert differing([one, shedding(0.99)]) == []
    weights, fault = replace(one.metadata.weights, lift=9.0), InjectedFault(text="dead:sensor=base_0@4..", acted=3)
    other = shedding(weights=weights, faults=(fault,), settle=8.0, drive="steps")
    assert differing([one, other]) == [
        ("left out of the averages / t_c", ["4", "8"]),
        ("drive", ["none", "steps"]),
        ("disturbances", ["none", "dead:sensor=base_0@4.."]),
        ("mpc.weights.lift", [f"{one.metadata.weights.lift}", "9.0"]),
    ]


def test_request_states_and_disturbances_are_listed_in_order(shedding):
    # A period is 20 ms; control is requested in period 60.
    faults = tuple(InjectedFault(text=text, acted=3) for text in ("ecu:drop:probability=1@1.25..1.3s", "noise:level=1"))
    log = shedding(modes={3: Mode.HOLD}, reasons={3: Reason.STREAM_LOST}, faults=faults)
    assert [tuple(event) for event in events(log)] == [
        (0, "set", "disturbed by noise:level=1"),
        (0, "state", "OFF: the jets are shut"),
        (60, "set", "control is requested"),
        (60, "state", "OFF to CONTROL: the jets follow the controller"),
        (63, "set", "disturbed by ecu:drop:probability=1"),
        (63, "state", "CONTROL to HOLD: no pressures arrived; the last command is held"),
        (64, "state", "HOLD to CONTROL: the jets follow the controller"),
        (65, "set", "no longer disturbed by ecu:drop:probability=1"),
    ]


def test_the_sensor_and_the_time_of_a_disturbance_are_known(shedding):
    for text, expected in {
        "dead:sensor=base_7@1.25..1.3": ([("base_7", "dead")], 63, 65),
        "bias:level=2,sensor=upper_39": ([("upper_39", "bias")], 0, 160),
        # In doubles, 2.14 s are more than 107 periods of 20 ms.
        "dead:sensor=base_7@2.14..2.3": ([("base_7", "dead")], 107, 115),
        "swap:sensors=a+b@1..": ([("a", "swap"), ("b", "swap")], 50, 160),
        # At no time: it begins with the run.
        "reset@x..nan": ([], 0, 160),
    }.items():
        (one,) = disturbed(shedding(faults=(InjectedFault(text=text, acted=1),)))
        assert (one.sensors, one.first, one.after) == expected, text


def test_a_loop_that_flaps_ends_in_a_count(shedding, monkeypatch):
    monkeypatch.setattr(listing, "MOST_EVENTS", 10)
    found = events(shedding(modes=dict.fromkeys(range(1, 99, 2), Mode.HOLD)))
    assert len(found) == 10 < MOST_EVENTS
    # 1 request, and OFF, CONTROL, then 49 times HOLD and back.
    assert found[-1].text == f"and {1 + 2 + 98 - 9} events more"
