"""The page of a run: complete, and safe against what a bundle's author wrote into it."""

import base64
import hashlib
import json
import re
from dataclasses import replace

import pytest
from PIL import Image

from can_bridge.wire.messages import Mode, Reason
from contract.errors import StillwakeError
from firmware_sim.runs import run_log
from firmware_sim.runs.run_log import RunFolder
from firmware_sim.runs.run_page.report import write_picture, write_report

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
def folder(shedding, tmp_path) -> RunFolder:
    return written(shedding(), tmp_path)


def test_names_are_escaped_and_none_ends_the_data(folder):
    log = run_log.load(folder.series)
    sensors = (*log.metadata.sensors[1:], "</script><!--")
    script = "<script>alert('a')</script>"
    hostile = replace(log.metadata, controller=script, signer="<b>", plant='"><img src=x>', sensors=sensors)
    run_log.save(folder.series, replace(log, metadata=hostile))
    page = write_report(folder).read_text(encoding="utf-8")
    assert "&lt;script&gt;" in page
    assert "signed by key &lt;b&gt;" in page
    assert all(text not in page for text in ("<script>alert", "<b>", "src=x>", "<!--"))
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


def test_a_faulted_run_has_a_red_box_before_anything_else_and_one_without_a_plan_has_a_page(shedding, folder):
    modes, reasons = ({2: value} for value in (Mode.FAULT, Reason.SENSOR_INVALID))
    run_log.save(folder.series, shedding(modes=modes, reasons=reasons))
    page = write_report(folder).read_text(encoding="utf-8")
    box = page.index('<p class="trouble" role="alert">ECU FAULT: SENSOR_INVALID at t = 12.4 t_c')
    assert box < page.index("<table>") < page.index('<caption class="trouble">ECU FAULT') < page.index("mean Cd (wall)")
    run_log.save(folder.series, shedding(modes=dict.fromkeys(range(100), Mode.OFF), skipped=range(100)))
    assert write_report(folder).is_file()


def test_a_picture_names_its_bundle_and_one_of_another_kind_is_refused(folder, tmp_path):
    for kind, start in (("png", b"\x89PNG"), ("pdf", b"%PDF")):
        write_picture(folder, tmp_path / f"run.{kind}")
        assert (tmp_path / f"run.{kind}").read_bytes().startswith(start)
    with Image.open(tmp_path / "run.png") as image:
        assert image.info["Description"] == "stillwake bundle " + "0123456789abcdef" * 4
    with pytest.raises(StillwakeError, match=r"x\.xyz: must be a file ending in \.png, \.pdf, \.svg"):
        write_picture(folder, tmp_path / "x.xyz")
    folder.controlled_picture.unlink()
    with pytest.raises(StillwakeError, match=r"vorticity_controlled\.png: No such file"):
        write_report(folder)
