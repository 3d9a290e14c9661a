"""Take the documents' pictures of the live page: `make pictures`, after `docs/release_pictures.py`.

    python -m docs.page_pictures

A server runs the shipped release on the live wake. When control has calmed the wake, a sensor dies. Pictures of the
page in a dark, a light and a narrow window follow. `docs/pictures/provenance.json` has the pictures' hashes.
"""

import io
import json
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, Literal

from PIL import Image
from playwright.sync_api import Browser, Page, sync_playwright

from contract.errors import StillwakeError
from contract.release import bundle
from contract.shipped import BUNDLE
from docs.release_pictures import PROVENANCE, sha256

DOCS: Final = Path(__file__).resolve().parent
WIDE: Final = (1440, 1180)
NARROW: Final = (390, 844)
Scheme = Literal["dark", "light"]
PICTURES: Final[dict[Path, tuple[tuple[int, int], Scheme]]] = {
    DOCS / "pictures" / "live_page.webp": (WIDE, "dark"),
    DOCS / "pictures" / "live_page_light.webp": (WIDE, "light"),
    DOCS / "pictures" / "live_page_phone.webp": (NARROW, "dark"),
}
"""The window's size in pixels and the colour scheme of each picture, by the picture's file."""
QUALITY: Final = 82
MOST_BYTES: Final = 300_000
DEAD: Final = "base_9"
DIES, TAKEN = 42.0, 59.2
"""Times in t_c at which the sensor dies, and at which the pictures are taken: after the ECU has excluded the sensor."""
PATIENCE_S: Final = 1800.0
_ARGUMENTS: Final = ("--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking")


def main() -> None:
    """Take all pictures. Raises StillwakeError if there is no browser, or if the server ends."""
    with _server() as url, chromium() as browser:
        pages = {path: _opened(browser, url, *how) for path, how in PICTURES.items()}
        first, *_ = pages.values()
        _until(first, DIES)
        first.locator("[data-setting=dead]").select_option(DEAD)
        _until(first, TAKEN)
        for path, page in pages.items():
            write(path, page.screenshot())
    note(PICTURES)


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


def _opened(browser: Browser, url: str, size: tuple[int, int], scheme: Scheme) -> Page:
    page = browser.new_page(
        viewport={"width": size[0], "height": size[1]},
        color_scheme=scheme,
        device_scale_factor=2.0 if size == NARROW else 1.0,
    )
    page.goto(url)
    page.locator("#intro-done").click()
    return page


def _until(page: Page, t: float) -> None:
    """Wait until the loop has reached the time t in t_c."""
    end = time.monotonic() + PATIENCE_S
    while (page.evaluate("stillwake.page.stream.now?.t") or 0.0) < t:
        if time.monotonic() > end:
            raise StillwakeError(f"the loop did not reach t = {t:g} within {PATIENCE_S:g} s")
        time.sleep(0.2)


def write(path: Path, png: bytes) -> None:
    """Write a picture as WebP. Raises StillwakeError if it is too large for the documents."""
    with Image.open(io.BytesIO(png)) as image:
        image.convert("RGB").save(path, quality=QUALITY, method=6)
    if path.stat().st_size > MOST_BYTES:
        raise StillwakeError(f"{path.name}: has {path.stat().st_size} bytes; must have at most {MOST_BYTES}")


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


def note(pictures: Iterable[Path]) -> None:
    """Record the pictures' hashes. Raises StillwakeError if the record is for a bundle other than the shipped
    bundle."""
    content = json.loads(PROVENANCE.read_text(encoding="utf-8"))
    shipped = bundle.load(BUNDLE).digest
    if content["bundle"] != shipped:
        raise StillwakeError(f"{PROVENANCE.name}: is not for the shipped bundle; run docs/release_pictures.py first")
    content["files"] |= {str(path.relative_to(DOCS.parent)): sha256(path) for path in pictures}
    PROVENANCE.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    try:
        main()
    except StillwakeError as error:
        sys.exit(f"error: {error}")
