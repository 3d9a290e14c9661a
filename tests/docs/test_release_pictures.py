"""The pictures of the closed loop are of the release that is shipped."""

import hashlib
import json
from pathlib import Path

import pytest
from PIL import Image

from contract.release import bundle
from contract.shipped import BUNDLE

ROOT = Path(__file__).resolve().parents[2]
PROVENANCE = json.loads((ROOT / "docs" / "pictures" / "provenance.json").read_text(encoding="utf-8"))


def test_they_are_of_the_shipped_bundle():
    assert PROVENANCE["bundle"] == bundle.load(BUNDLE).digest, "another release is shipped: `make pictures`"


PICTURES = ["docs/demo.png"] + [
    f"docs/pictures/{name}.webp"
    for name in ("closed_loop", "run_page", "compare_page", "live_page", "live_page_light", "live_page_phone")
]


@pytest.mark.parametrize("name", PICTURES)
def test_they_are_the_files_that_were_drawn(name):
    found = hashlib.sha256((ROOT / name).read_bytes()).hexdigest()
    assert PROVENANCE["files"][name] == found, f"{name} was altered: `make pictures`"


def test_the_overview_names_its_bundle():
    with Image.open(ROOT / "docs" / "demo.png") as image:
        assert image.info["Description"] == f"stillwake bundle {PROVENANCE['bundle']}"
