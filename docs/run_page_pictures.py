"""Take the documents' pictures of pages of runs: `make pictures`, after `docs/page_pictures.py`.

    python -m docs.run_page_pictures RUN_FOLDER OTHER_FOLDER

The pictures show the first run's page and a comparison of both runs, at a time when control has calmed the wake.
`docs/pictures/provenance.json` has the pictures' hashes.
"""

import sys
import tempfile
from pathlib import Path
from typing import Final

from playwright.sync_api import Browser

from contract.errors import StillwakeError
from docs.page_pictures import Scheme, chromium, note, write
from firmware_sim.runs.run_log import RunFolder
from firmware_sim.runs.run_page.report import write_comparison, write_report

DOCS: Final = Path(__file__).resolve().parent
RUN: Final = DOCS / "pictures" / "run_page.webp"
COMPARED: Final = DOCS / "pictures" / "compare_page.webp"
WINDOW: Final = (1280, 1080)
SHOWN: Final = 0.8
"""The time that the pages show, divided by the run's duration."""
_DRAWN_MS: Final = 2000
"""Waiting time in ms, in which the browser decodes the stills and draws the canvases."""


def main(folders: list[RunFolder]) -> None:
    """Write both pages and take their pictures. Raises StillwakeError if there is no browser, or if a folder is not
    a run's folder."""
    with tempfile.TemporaryDirectory() as place, chromium() as browser:
        _take(browser, write_report(folders[0], Path(place) / "run.html"), "dark", RUN)
        _take(browser, write_comparison(folders, Path(place) / "compare.html"), "light", COMPARED)
    note((RUN, COMPARED))


def _take(browser: Browser, page: Path, scheme: Scheme, target: Path) -> None:
    shown = browser.new_page(viewport={"width": WINDOW[0], "height": WINDOW[1]}, color_scheme=scheme)
    shown.goto(page.as_uri())
    slider = shown.get_by_role("slider", name="Time in the run")
    slider.fill(str(round(SHOWN * float(slider.get_attribute("max") or 0))))
    slider.blur()
    shown.locator("section.replay").evaluate("section => section.scrollIntoView()")
    shown.wait_for_timeout(_DRAWN_MS)
    write(target, shown.screenshot())
    shown.close()


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit("usage: python -m docs.run_page_pictures RUN_FOLDER OTHER_FOLDER")
    try:
        main([RunFolder(Path(folder)) for folder in sys.argv[1:]])
    except StillwakeError as error:
        sys.exit(f"error: {error}")
