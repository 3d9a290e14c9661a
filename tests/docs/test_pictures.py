"""Pictures that are drawn from results or from the release are of those that are there."""

import hashlib
import json
from pathlib import Path

from PIL import Image

from benchmarks.common.documents import SOURCE, source_text
from contract.release import bundle
from contract.shipped import BUNDLE

ROOT = Path(__file__).resolve().parents[2]
PICTURES = ROOT / "docs" / "pictures"
NOT_FROM_RESULTS = {"mean_flow.png"}
"""Drawn by `stillwake picture --field mean`."""


def test_pictures_from_results_name_the_present_file():
    for path in PICTURES.glob("*.png"):
        if path.name not in NOT_FROM_RESULTS:
            with Image.open(path) as image:
                stated = image.info[SOURCE]
            place = ROOT / stated.partition(" ")[0]
            assert source_text(place) == stated, f"{path.name} is stale: `python -m benchmarks pictures`"


def test_pictures_of_the_closed_loop_are_of_the_shipped_bundle():
    provenance = json.loads((PICTURES / "provenance.json").read_text(encoding="utf-8"))
    assert provenance["bundle"] == bundle.load(BUNDLE).digest, "another release is shipped: `make pictures`"
    names = ("closed_loop", "run_page", "compare_page", "live_page", "live_page_light", "live_page_phone")
    for name in ("docs/demo.png", *(f"docs/pictures/{name}.webp" for name in names)):
        digest = hashlib.sha256((ROOT / name).read_bytes()).hexdigest()
        assert provenance["files"][name] == digest, f"{name} was altered: `make pictures`"
    with Image.open(ROOT / "docs" / "demo.png") as image:
        assert image.info["Description"] == f"stillwake bundle {provenance['bundle']}"
