"""Take the documents' pictures of runs of the shipped release and of the live page: `make pictures`.

    python -m docs.pictures_of_runs RUN_FOLDER OTHER_FOLDER

The first run's overview and film are drawn. Then a server runs the shipped release on the live wake. When control has
calmed the wake, a sensor dies, and pictures of the live page in a dark, a light and a narrow window follow. Pictures of
the first run's page, and of a comparison of both runs, are at a time when control has calmed the wake.
`docs/pictures/provenance.json` has the bundle, the run, and the pictures' hashes; a test fails if the shipped bundle is
another bundle.
"""

import io
import json
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, Literal

from PIL import Image
from playwright.sync_api import Browser, Page, sync_playwright

from contract.errors import StillwakeError
from contract.release import bundle
from contract.release.checks import sha256
from contract.shipped import BUNDLE
from examples.film_of_a_run import story_of, write_film
from firmware_sim.runs import run_log
from firmware_sim.runs.run_log import RunFolder
from firmware_sim.runs.run_page.report import write_comparison, write_picture, write_report

DOCS: Final = Path(__file__).resolve().parent
PICTURES: Final = DOCS / "pictures"
PROVENANCE: Final = PICTURES / "provenance.json"
OVERVIEW: Final = DOCS / "demo.png"
ANIMATION, RUN, COMPARED = (PICTURES / f"{name}.webp" for name in ("closed_loop", "run_page", "compare_page"))
Size = tuple[int, int]
Scheme = Literal["dark", "light"]
WIDE, NARROW, OF_RUNS = (1440, 1180), (390, 844), (1280, 1080)
LIVE: Final[dict[Path, tuple[Size, Scheme]]] = {
    PICTURES / "live_page.webp": (WIDE, "dark"),
    PICTURES / "live_page_light.webp": (WIDE, "light"),
    PICTURES / "live_page_phone.webp": (NARROW, "dark"),
}
"""The window's size in pixels and the colour scheme of each picture of the live page, by the picture's file."""
QUALITY: Final = 82
MOST_BYTES: Final = 300_000
DEAD: Final = "base_9"
DIES, TAKEN = 42.0, 59.2
"""Times in t_c at which the sensor dies, and at which the pictures are taken: after the ECU has excluded the sensor."""
PATIENCE_S: Final = 1800.0
_ARGUMENTS: Final = ("--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking")


def main(folders: list[RunFolder]) -> None:
    """Draw and take all pictures, and write their provenance. Raises StillwakeError if there is no browser, a folder is
    not a run's folder, the first run is not of the shipped bundle, or the server ends."""
    log, shipped = run_log.load(folders[0].series), bundle.load(BUNDLE).digest
    if log.metadata.digest != shipped:
        raise StillwakeError(f"{folders[0].path}: is of bundle {log.metadata.digest[:12]}; shipped is {shipped[:12]}")
    write_picture(folders[0], OVERVIEW)
    write_film(ANIMATION, log, story_of(log))
    with chromium() as browser:
        with _server() as url:
            _take_live(browser, url)
        with tempfile.TemporaryDirectory() as place:
            _take(browser, write_report(folders[0], Path(place) / "run.html"), "dark", RUN)
            _take(browser, write_comparison(folders, Path(place) / "compare.html"), "light", COMPARED)
    taken = (OVERVIEW, ANIMATION, *LIVE, RUN, COMPARED)
    files = {str(path.relative_to(DOCS.parent)): sha256(path.read_bytes()) for path in taken}
    summary = sha256(folders[0].summary.read_bytes())
    content = {"bundle": shipped, "run": log.metadata.origin.day, "summary": summary, "files": files}
    PROVENANCE.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


@contextmanager
def chromium() -> Iterator[Browser]:
    """Run a headless browser. Raises StillwakeError if none is installed."""
    found = shutil.which("chromium") or shutil.which("google-chrome")
    if found is None:
        raise StillwakeError("no browser: install chromium")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found, args=list(_ARGUMENTS))
        yield browser
        browser.close()


@contextmanager
def _server() -> Iterator[str]:
    """Run the server until the `with` block ends, and yield the page's address."""
    command = [sys.executable, "-m", "stillwake", "live", "--port", "0", "--fast"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        found = (re.search(r"http://\S+", line) for line in process.stdout)
        url = next(filter(None, found), None)
        if url is None:
            raise StillwakeError("the server ended before it had an address")
        yield url.group()
    finally:
        process.terminate()
        process.wait()


def _take_live(browser: Browser, url: str) -> None:
    pages = {path: _opened(browser, url, *how) for path, how in LIVE.items()}
    for page in pages.values():
        page.locator("#intro-done").click()
    first, *_ = pages.values()
    _until(first, DIES)
    first.locator("[data-setting=dead]").select_option(DEAD)
    _until(first, TAKEN)
    for path, page in pages.items():
        _write(path, page)


def _opened(browser: Browser, url: str, size: Size, scheme: Scheme) -> Page:
    page = browser.new_page(
        viewport={"width": size[0], "height": size[1]},
        color_scheme=scheme,
        device_scale_factor=2.0 if size == NARROW else 1.0,
    )
    page.goto(url)
    return page


def _until(page: Page, t: float) -> None:
    """Wait until the loop has reached the time t in t_c."""
    end = time.monotonic() + PATIENCE_S
    while (page.evaluate("stillwake.page.stream.now?.t") or 0.0) < t:
        if time.monotonic() > end:
            raise StillwakeError(f"the loop did not reach t = {t:g} within {PATIENCE_S:g} s")
        time.sleep(0.2)


def _take(browser: Browser, file: Path, scheme: Scheme, target: Path) -> None:
    page = _opened(browser, file.as_uri(), OF_RUNS, scheme)
    slider = page.get_by_role("slider", name="Time in the run")
    slider.fill(str(round(0.8 * float(slider.get_attribute("max") or 0))))
    slider.blur()
    page.locator("section.replay").evaluate("section => section.scrollIntoView()")
    page.wait_for_timeout(2000)  # the browser decodes the stills and draws the canvases
    _write(target, page)
    page.close()


def _write(path: Path, page: Page) -> None:
    """Write a picture of a page as WebP. Raises StillwakeError if it is too large for the documents."""
    with Image.open(io.BytesIO(page.screenshot())) as image:
        image.convert("RGB").save(path, quality=QUALITY, method=6)
    if path.stat().st_size > MOST_BYTES:
        raise StillwakeError(f"{path.name}: has {path.stat().st_size} bytes; must have at most {MOST_BYTES}")


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit("usage: python -m docs.pictures_of_runs RUN_FOLDER OTHER_FOLDER")
    try:
        main([RunFolder(Path(folder)) for folder in sys.argv[1:]])
    except StillwakeError as error:
        sys.exit(f"error: {error}")
