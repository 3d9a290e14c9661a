"""Draw `docs/demo.png` and `docs/pictures/closed_loop.webp` from a run of the shipped release: `make pictures`.

    python -m docs.release_pictures RUN_FOLDER

`docs/pictures/provenance.json` states the bundle and the run; a test fails if the shipped bundle is another bundle.
"""

import hashlib
import json
import sys
from pathlib import Path
from typing import Final

from contract.errors import StillwakeError
from contract.release import bundle
from contract.shipped import BUNDLE
from examples.film_of_a_run import story_of, write_film
from firmware_sim.runs import run_log
from firmware_sim.runs.run_log import RunFolder
from firmware_sim.runs.run_page.report import write_picture

DOCS: Final = Path(__file__).resolve().parent
OVERVIEW: Final = DOCS / "demo.png"
ANIMATION: Final = DOCS / "pictures" / "closed_loop.webp"
PROVENANCE: Final = DOCS / "pictures" / "provenance.json"


def main(folder: RunFolder) -> None:
    """Draw both pictures from a run folder. Raises StillwakeError if the run is not of the shipped bundle."""
    log = run_log.load(folder.series)
    shipped = bundle.load(BUNDLE).digest
    if log.metadata.digest != shipped:
        raise StillwakeError(f"{folder.path}: is of bundle {log.metadata.digest[:12]}; shipped is {shipped[:12]}")
    write_picture(folder, OVERVIEW)
    write_film(ANIMATION, log, story_of(log))
    pictures = {str(path.relative_to(DOCS.parent)): sha256(path) for path in (OVERVIEW, ANIMATION)}
    content = {"bundle": shipped, "run": log.metadata.origin.day, "summary": sha256(folder.summary), "files": pictures}
    PROVENANCE.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def sha256(path: Path) -> str:
    """Return the SHA-256 of a file in hexadecimal digits."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python docs/release_pictures.py RUN_FOLDER")
    try:
        main(RunFolder(Path(sys.argv[1])))
    except StillwakeError as error:
        sys.exit(f"error: {error}")
