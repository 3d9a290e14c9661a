"""The pages of runs in a browser: what moves together, for every reader, and without a request to anyone."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from can_bridge.wire.messages import Mode
from contract.arrays import Array
from firmware_sim.runs import run_log, wake_stills
from firmware_sim.runs.metadata import InjectedFault
from firmware_sim.runs.run_log import WALL, RunFolder
from firmware_sim.runs.run_page.report import write_comparison, write_report
from firmware_sim.runs.wake_stills import Scene, WakeRecorder, WakeStills
from tests.browser import PHONE, Visit, visit
from tests.firmware_sim.runs.conftest import shedding_log
from tests.firmware_sim.runs.run_page.test_report import written

pytestmark = pytest.mark.browser
PLACES = {"upper_39": (7.4, 0.5), "lower_39": (7.4, -0.5), "base_0": (7.647, 0.4), "base_9": (7.647, -0.4)}
BRIGHT = """(canvas) => {
  // Along the lowest row: behind the body nothing is drawn over the flow.
  const {width, height} = canvas;
  const row = canvas.getContext('2d').getImageData(0, height - 3, width, 1).data;
  let [sum, weight] = [0, 0];
  for (let x = 0; x < width; x += 1) {
    const dark = 765 - row[4 * x] - row[4 * x + 1] - row[4 * x + 2];
    sum += x * dark;
    weight += dark;
  }
  return weight > 1000 ? sum / weight / width : -1;
}"""
"""Where the bar of `recorded` stands, as a share of the picture's width; -1 where there is none."""
CLOSE = 0.03


def recorded(times: Array) -> WakeStills:
    """A bright bar that moves on by two columns a period."""
    recorder = WakeRecorder(Scene(view=(4.5, 16.5, -2.25, 2.25), size=(480, 180), sensors=PLACES), len(times))
    for k, t in enumerate(times):
        levels = np.zeros((180, 480), dtype=np.int8)
        levels[:, 2 * k : 2 * k + 16] = 120
        recorder.record(k, float(t), levels.copy)
    return recorder.recorded()


@pytest.fixture(scope="module")
def runs(run_metadata, tmp_path_factory) -> list[RunFolder]:
    """One that held control; one that did not, with a hostile name and a long word; one of an earlier version."""
    place, metadata = tmp_path_factory.mktemp("runs"), replace(run_metadata, sensors=tuple(PLACES))
    long = InjectedFault(text="ecu:drop:probability=0.4,at=receive,frame_ids=0x120@0.5..1.2", acted=3)
    hostile = replace(metadata, controller="</script><img src=x onerror=alert(1)>", faults=(long,))
    logs = (shedding_log(metadata), shedding_log(hostile, modes={3: Mode.HOLD}), shedding_log(metadata, Cd=0.95))
    folders, stills = [], recorded(logs[0].series["t"])
    for name, log in zip(("held", "lost", "old"), logs, strict=True):
        (place / name).mkdir()
        wall = np.linspace(-0.8, 0.0, len(log.series["t"]))[:, None] * np.ones((1, len(PLACES)))
        log = replace(log, series={**log.series, WALL: wall})
        folders.append(written(log, place / name))
        if name != "old":
            wake_stills.save(folders[-1].wake, stills)
            write_report(folders[-1])
    return folders


@pytest.fixture(scope="module")
def comparison(runs) -> Path:
    return write_comparison(runs, runs[0].path.parent / "compare.html")


def stands_at(seen: Visit, canvas: str, period: int) -> None:
    until(seen, f"Math.abs(({BRIGHT})(document.querySelector('{canvas}')) - {(2 * period + 8) / 480}) < {CLOSE}")


def until(seen: Visit, holds: str) -> None:
    """Wait for it; the page's own policy forbids playwright's way to do so."""
    for _ in range(200):
        if seen.page.evaluate(holds):
            return
        seen.page.wait_for_timeout(50)
    pytest.fail(f"never: {holds}")


def test_the_slider_moves_wake_words_and_cursor_and_plays(browser, runs):
    url = runs[0].report.as_uri()
    seen = visit(browser, url, home=url)
    slider = seen.page.get_by_role("slider", name="Time in the run")
    # It begins where control is requested.
    stands_at(seen, "#wake canvas", 60)
    slider.focus()
    for key, period in (("ArrowRight", 61), ("Home", 0), ("End", 159), ("PageDown", 143)):
        seen.page.keyboard.press(key)
        assert int(slider.input_value()) == period
        stands_at(seen, "#wake canvas", period)
        words = slider.get_attribute("aria-valuetext")
        assert words is not None and f"t = {0.2 * period:.1f} W" in words
        assert seen.page.locator("#player output").inner_text() == words
    assert seen.page.locator("#wake .sensors .value").first.inner_text() == f"\N{MINUS SIGN}{0.8 - 0.8 * 143 / 159:.2f}"
    # A click into a curve, in the middle of its time, and one on an event.
    over = seen.page.locator("#curves .u-over").first
    over.scroll_into_view_if_needed()
    over.click()
    assert int(slider.input_value()) == pytest.approx(80, abs=2)
    seen.page.get_by_role("button", name="0.0", exact=True).click()
    assert slider.input_value() == "0"
    seen.page.get_by_role("button", name="Play").click()
    until(seen, "document.querySelector('#player input').value > 5")
    seen.page.get_by_role("button", name="Pause").click()
    stopped = slider.input_value()
    seen.page.wait_for_timeout(200)
    assert slider.input_value() == stopped
    assert not seen.troubles


def test_runs_are_compared_at_one_time_since_the_request(browser, runs, comparison):
    url = comparison.as_uri()
    seen = visit(browser, url, home=url)
    slider = seen.page.get_by_role("slider", name="Time in the run")
    # It opens where the last run's drag leaves that of the others.
    drags = [run_log.load(folder.series).series["Cd"].round(5) for folder in runs]
    assert int(slider.input_value()) == np.flatnonzero(drags[0] != drags[2])[0]
    seen.page.get_by_role("button", name="Control requested").click()
    for number in (1, 2):
        stands_at(seen, f"#wake-{number} canvas", 60)
    slider.focus()
    for _ in range(3):
        seen.page.keyboard.press("ArrowRight")
    for number in (1, 2):
        stands_at(seen, f"#wake-{number} canvas", 63)
    # In period 63 the second run held its command.
    assert seen.page.locator("#now-1").inner_text().startswith("CONTROL")
    assert seen.page.locator("#now-2").inner_text().startswith("HOLD")
    assert seen.page.get_by_text("The wake of this run was not recorded").count() == 1
    assert not seen.is_wider_than_its_window
    assert not seen.troubles


@pytest.mark.parametrize("compared", [False, pytest.param(True, marks=pytest.mark.proofs)], ids=["run", "others"])
def test_pages_open_without_a_fault_for_all_readers_and_on_paper(browser, runs, comparison, compared):
    others = [(comparison, 1280, False), (comparison, PHONE, True), (runs[1].report, 1280, False)]
    for page, width, dark in others if compared else [(runs[1].report, PHONE, True)]:
        seen = visit(browser, page.as_uri(), home=page.as_uri(), width=width, dark=dark)
        assert not seen.violations(), (page, width, dark)
        assert not seen.is_wider_than_its_window, (page, width, dark)
        assert seen.page.locator("html.scripted").count() == 1
        assert not seen.troubles, (page, width, dark)
        if not compared:
            seen.page.emulate_media(media="print")
            assert seen.page.get_by_alt_text("vorticity under control").is_visible()
            assert seen.page.locator("#curves canvas").first.is_visible()
            assert not seen.page.locator("#player").is_visible()
        seen.page.context.close()


def test_without_scripts_the_pictures_are_there(browser, runs):
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(runs[0].report.as_uri())
    assert page.get_by_alt_text("vorticity under control").is_visible()
    assert page.locator("noscript p").is_visible()
    assert not page.locator("#player").is_visible()
    context.close()
