"""What is shipped belongs together: start, recording, bundle and the figures shown for them."""

import hashlib
import json
from collections import Counter
from pathlib import Path

import pytest

from contract import bundle, dataset
from contract.config_loading import load_config

ROOT = Path(__file__).resolve().parent.parent
DATA = ROOT / "wake" / "data"
RELEASE = ROOT / "firmware_sim" / "data" / "bundle"


@pytest.mark.parametrize("name", ["developed.npz", "recording.h5", "paper.h5"])
def test_the_provenance_record_names_this_very_file(name: str) -> None:
    record = json.loads((DATA / "provenance.json").read_text(encoding="utf-8"))[name]
    assert record["sha256"] == hashlib.sha256((DATA / name).read_bytes()).hexdigest()
    assert record["command"].startswith("stillwake ")


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("recording.h5", {"training": 6000, "chirp": 1500, "none": 500}),
        ("paper.h5", {"training": 50000, "none": 2500, "chirp": 10000, "extended_chirp": 10000}),
    ],
)
def test_the_recordings_hold_what_the_documents_say(name: str, expected: dict[str, int]) -> None:
    steps: Counter[str] = Counter()
    for episode in dataset.read(DATA / name).episodes:
        steps[str(episode.provenance["forcing_signal"])] += len(episode)
    assert steps == expected


def test_the_release_was_trained_on_the_shipped_recording() -> None:
    release = bundle.load(RELEASE)
    assert (
        release.manifest.provenance["dataset_sha256"]
        == hashlib.sha256((DATA / "recording.h5").read_bytes()).hexdigest()
    )
    assert (release.manifest.precision, len(release.manifest.sensors)) == ("int8", 4)
    assert release.manifest.mpc == load_config().mpc


def test_the_shown_figures_are_this_releases() -> None:
    figures = json.loads((ROOT / "results" / "demo.json").read_text(encoding="utf-8"))["figures"]
    assert bundle.load(RELEASE).digest[:12] in figures["controller"]
    # A drag reduction counts only while the side force does not grow.
    assert figures["abs_Cl_controlled"] <= figures["abs_Cl_uncontrolled"]
