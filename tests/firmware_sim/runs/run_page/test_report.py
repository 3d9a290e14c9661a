"""The page of a run: complete, and safe against what a bundle's author wrote into it."""

import base64
import hashlib
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from jinja2 import UndefinedError
from PIL import Image

from can_bridge.wire.messages import Mode, Reason
from contract.errors import StillwakeError
from firmware_sim.runs import pages, run_log, wake_stills
from firmware_sim.runs.pictures import mode_spans
from firmware_sim.runs.run_folder import RunFolder
from firmware_sim.runs.run_page.report import write_picture, write_report
from firmware_sim.runs.wake_stills import Scene, WakeRecorder

pytestmark = pytest.mark.slow  # draws a page for each case

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
def folder(shedding, tmp_path, monkeypatch) -> RunFolder:
    """Of a run whose page has its figures without their drawing, which is most of its time."""
    monkeypatch.setattr(pages, "png_of", lambda figure: ONE_PIXEL)
    return written(shedding(), tmp_path)


def test_names_are_escaped(folder):
    log = run_log.load(folder.series)
    hostile = replace(log.metadata, controller="<script>alert('a')</script>", signer="<b>", plant='"><img src=x>')
    run_log.save(folder.series, replace(log, metadata=hostile))
    page = write_report(folder).read_text(encoding="utf-8")
    assert "&lt;script&gt;" in page
    assert "signed by key &lt;b&gt;" in page
    assert all(text not in page for text in ("<script>alert", "<b>", "src=x>"))


def test_nothing_in_a_name_ends_the_data(folder):
    log = run_log.load(folder.series)
    hostile = (*log.metadata.sensors[1:], "</script><!--")
    run_log.save(folder.series, replace(log, metadata=replace(log.metadata, sensors=hostile)))
    page = write_report(folder).read_text(encoding="utf-8")
    data = re.search(r'<script type="application/json" id="run">(.*?)</script>', page, re.DOTALL)
    assert data is not None
    assert json.loads(data[1])["sensors"][-1] == "</script><!--"
    assert "<!--" not in page


def test_the_page_runs_its_own_scripts_only(folder):
    page = write_report(folder).read_text(encoding="utf-8")
    scripts = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    policy = re.search(r'http-equiv="Content-Security-Policy" content="([^"]*)"', page)
    assert policy is not None
    allowed = re.findall(r"sha256-([^ ;]+)&#39;", policy[1])
    assert len(scripts) > 10
    assert allowed == [base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in scripts]
    assert policy[1].startswith("default-src &#39;none&#39;;")


def test_the_recorded_wake_is_on_the_page(folder):
    log = run_log.load(folder.series)
    scene = Scene(view=(4.5, 16.5, -2.25, 2.25), size=(96, 36), sensors={"base_0": (7.5, 0.1)})
    recorder = WakeRecorder(scene, len(log.series["t"]))
    for k, t in enumerate(log.series["t"]):
        recorder.record(k, t, lambda: np.zeros((36, 96), dtype=np.int8))
    stills = recorder.recorded()
    wake_stills.save(folder.wake, stills)
    page = write_report(folder).read_text(encoding="utf-8")
    assert base64.b64encode(stills.stills[7]).decode() in page
    folder.wake.write_bytes(folder.wake.read_bytes()[:-50])
    with pytest.raises(StillwakeError, match=r"wake\.npz: not the recorded wake of this run"):
        write_report(folder)
    assert folder.report.read_text(encoding="utf-8") == page


def test_settings_and_bit_rates_are_on_the_page(folder):
    page = write_report(folder).read_text(encoding="utf-8")
    for text in (
        "2026-01-02",
        "unsigned",
        "mpc.horizon = 8",
        "mpc.weights.lift = 0.01",
        "ecu.compute_time_ms = 8.0",
        "ecu.delay_steps = 0",
        "vehicle.actuator_delay = 0",
        "bus.e2e.window = 5",
        "operating_point.speed = 25.0",
        "500 kbit/s",
        "2 Mbit/s",
        "Re = 500",
        "between 4\nconvective times",
        "stillwake run a",
        'name="viewport"',
    ):
        assert text in page, text
    # A folder of an earlier version has no recorded wake.
    assert '"wake":null' in page
    # The series twice, for a phone and for a desk; the step's time; the wake twice.
    assert page.count("data:image/png;base64,") == 5
    assert 'class="trouble" role' not in page


def test_a_faulted_run_has_a_red_box_before_anything_else(shedding, tmp_path):
    modes, reasons = ({2: value} for value in (Mode.FAULT, Reason.SENSOR_INVALID))
    page = write_report(written(shedding(modes=modes, reasons=reasons), tmp_path)).read_text(encoding="utf-8")
    box = page.index('<p class="trouble" role="alert">ECU FAULT: SENSOR_INVALID at t = 12.4 t_c')
    assert box < page.index("<table>") < page.index('<caption class="trouble">ECU FAULT') < page.index("mean Cd (wall)")


def test_a_run_without_averages_says_so_on_its_page(shedding, tmp_path):
    page = write_report(written(shedding(averages=False), tmp_path)).read_text(encoding="utf-8")
    assert "No averages were asked for." in page
    assert "whole shedding cycles" not in page


def test_the_strip_shows_every_stretch_of_a_mode(shedding):
    log = shedding(modes={3: Mode.HOLD}, skipped=[5, 6])
    assert mode_spans(log) == [
        ("OFF", 0, 60), ("CONTROL", 60, 63), ("HOLD", 63, 64), ("CONTROL", 64, 65), ("SKIPPED", 65, 67),
        ("CONTROL", 67, 160),
    ]  # fmt: skip


def test_a_run_in_which_nothing_was_planned_can_be_drawn(shedding, tmp_path):
    nothing = shedding(modes=dict.fromkeys(range(100), Mode.OFF), skipped=range(100))
    assert write_report(written(nothing, tmp_path)).is_file()


def test_a_picture_names_its_bundle(folder, tmp_path):
    write_picture(folder, tmp_path / "run.png")
    with Image.open(tmp_path / "run.png") as image:
        assert image.info["Description"] == "stillwake bundle " + "0123456789abcdef" * 4
    write_picture(folder, tmp_path / "run.svg")
    assert "stillwake bundle 0123456789abcdef" in (tmp_path / "run.svg").read_text()
    write_picture(folder, tmp_path / "run.pdf")
    assert (tmp_path / "run.pdf").read_bytes().startswith(b"%PDF")


def test_a_picture_of_another_kind_is_refused_by_name(folder, tmp_path):
    before = sorted(tmp_path.iterdir())
    with pytest.raises(StillwakeError, match=r"x\.xyz: must be a file ending in \.png, \.pdf, \.svg"):
        write_picture(folder, tmp_path / "x.xyz")
    assert sorted(tmp_path.iterdir()) == before


def test_a_template_without_a_value_is_an_error():
    with pytest.raises(UndefinedError):
        pages.render("report.html.j2")


def test_a_folder_without_its_pictures_is_refused(folder):
    folder.controlled_picture.unlink()
    with pytest.raises(StillwakeError, match=r"vorticity_controlled\.png: No such file"):
        write_report(folder)
