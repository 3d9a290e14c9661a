"""The page of a run: complete, and safe against what a bundle's author wrote into it."""

from dataclasses import replace

import pytest
from jinja2 import UndefinedError

from contract.errors import StillwakeError
from firmware_sim.runs import pages, run_log
from firmware_sim.runs.report import write_report
from firmware_sim.runs.run_folder import RunFolder

ONE_PIXEL = bytes.fromhex(
    "89504e470d0a1a0a0000000d4948445200000001000000010802000000907753de"
    "0000000c4944415408d763f8ffff3f0005fe02fea7350180000000000049454e44ae426082"
)


@pytest.fixture
def folder(log_of, tmp_path) -> RunFolder:
    folder = RunFolder(tmp_path)
    run_log.save(folder.series, log_of(Cd=[1.0] * 6))
    folder.uncontrolled_picture.write_bytes(ONE_PIXEL)
    folder.controlled_picture.write_bytes(ONE_PIXEL)
    return folder


def test_names_are_escaped(folder):
    log = run_log.load(folder.series)
    hostile = replace(log.metadata, controller="<script>alert('a')</script>", signer="<b>", plant='"><img src=x>')
    run_log.save(folder.series, replace(log, metadata=hostile))
    page = write_report(folder).read_text(encoding="utf-8")
    assert "&lt;script&gt;" in page
    assert "signed by key &lt;b&gt;" in page
    assert all(text not in page for text in ("<script", "<b>", "src=x>"))


def test_settings_and_bit_rates_are_on_the_page(folder):
    page = write_report(folder).read_text(encoding="utf-8")
    for text in (
        "unsigned",
        "horizon: 8",
        "ecu compute_time_ms: 8.0",
        "500 kbit/s",
        "2 Mbit/s",
        "Re = 500",
        "from 0.4",
    ):
        assert text in page, text
    assert page.count("data:image/png;base64,") == 3


def test_a_template_without_a_value_is_an_error():
    with pytest.raises(UndefinedError):
        pages.render("report.html.j2")


def test_a_folder_without_its_pictures_is_refused(folder):
    folder.controlled_picture.unlink()
    with pytest.raises(StillwakeError, match=r"vorticity_controlled\.png: No such file"):
        write_report(folder)
