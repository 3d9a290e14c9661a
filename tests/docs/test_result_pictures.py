"""Pictures that are drawn from results are of the results that are there."""

from pathlib import Path

import pytest
from PIL import Image

from benchmarks.common.pictures import PICTURES, SOURCE, source_text

ROOT = Path(__file__).resolve().parents[2]
NOT_FROM_RESULTS = {
    "mean_flow.png": "drawn by `stillwake picture mean`: the plant alone",
    "model_forces.png": "drawn from networks of the study, which are not shipped",
    "model_latents.png": "drawn from networks of the study, which are not shipped",
}


@pytest.mark.parametrize("name", sorted({path.name for path in PICTURES.glob("*.png")} - NOT_FROM_RESULTS.keys()))
def test_a_picture_is_of_the_present_results(name):
    with Image.open(PICTURES / name) as image:
        source = image.info[SOURCE]
    assert source == source_text(ROOT / source.split()[0]), f"{name} is stale: `python -m benchmarks pictures`"


def test_a_source_tells_two_contents_apart(tmp_path, monkeypatch):
    monkeypatch.setattr("benchmarks.common.pictures.ROOT", tmp_path)
    results = tmp_path / "results.json"
    texts = set()
    for content in ("1", "2"):
        results.write_text(content)
        texts.add(source_text(results))
    assert len(texts) == 2
