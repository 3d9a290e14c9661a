"""What is shipped belongs together: start, recording, bundle and the figures shown for them."""

import hashlib
import json
import shutil
import subprocess
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from contract.config.loading import load_config
from contract.model import model_folder
from contract.recording import dataset
from contract.release import bundle, signing
from contract.runtime.onnx_session import OnnxController
from contract.sensors import TRUCK
from wake.truck.state import developed_state
from wake.truck.truck_wake import TruckWake

ROOT = Path(__file__).resolve().parent.parent
DATA = ROOT / "data" / "stillwake_data"
RELEASE = ROOT / "contract" / "release" / "shipped"


def test_the_recording_holds_what_the_documents_say() -> None:
    steps: Counter[str] = Counter()
    rounds: Counter[int] = Counter()
    for episode in dataset.read(DATA / "recording.h5").episodes:
        steps[str(episode.provenance["forcing_signal"])] += len(episode)
        if episode.provenance["forcing_signal"] == "controlled":
            assert episode.role == "train"
            rounds[int(str(episode.provenance["round"]))] += len(episode)
    forced = {"training": 50000, "none": 2500, "chirp": 10000, "extended_chirp": 10000}
    assert steps - Counter(controlled=steps["controlled"]) == forced
    assert rounds == {1: 4400, 2: 4400}


@pytest.mark.slow  # the flow is computed
def test_the_recording_is_what_the_solver_does_from_the_shipped_start() -> None:
    episode = next(one for one in dataset.read(DATA / "recording.h5").episodes if one.name == "training_1")
    wake = TruckWake()
    wake.reset(developed_state())
    for _ in range(int(episode.provenance.get("lead_steps", 0))):
        wake.advance(0.0)
    for k, action in enumerate(episode.series["action"][:4]):
        # Recorded in 16 bits over +-1. An action a period late or early moves the probe by 1e-3 at once.
        assert wake.sample().Uy_probe == pytest.approx(episode.series["Uy_probe"][k], abs=1e-4)
        wake.advance(float(np.clip(action, -0.075, 0.075)))


def test_the_release_was_trained_on_the_shipped_recording() -> None:
    release = bundle.load(RELEASE, signing.project_key())
    assert release.is_trusted
    assert release.manifest.dataset_sha256 == hashlib.sha256((DATA / "recording.h5").read_bytes()).hexdigest()
    assert (release.manifest.precision, len(release.manifest.sensors)) == ("int8", 4)
    assert release.manifest.mpc == load_config().mpc


def test_the_shipped_model_is_the_releases_and_recorded() -> None:
    model = model_folder.read(DATA / "model")
    assert model.weights_sha256 == bundle.load(RELEASE).manifest.weights_sha256
    records = json.loads((DATA / "provenance.json").read_text(encoding="utf-8"))
    for name in ("developed.npz", "recording.h5"):
        assert records[name]["sha256"] == hashlib.sha256((DATA / name).read_bytes()).hexdigest()
        assert records[name]["command"].startswith("stillwake ")
    record = records["model"]
    for name, digest in record["sha256"].items():
        assert digest == hashlib.sha256((DATA / "model" / name).read_bytes()).hexdigest()
    assert set(record["sha256"]) == {item.name for item in (DATA / "model").iterdir()}
    assert record["recording_sha256"] == model.description.dataset_sha256
    assert record["command"].startswith("stillwake ")


@pytest.mark.slow  # runs the graph on a hundred windows
def test_the_weights_of_the_release_mean_what_they_are_called() -> None:
    """Predicted |Cl| and the plan's size, over windows of the test episode, under other weights.

    `tests/benchmarks/release/test_weights.py` has the closed loop.
    """
    release = bundle.load(RELEASE)
    controller, sizes = OnnxController.of(release), release.manifest.sizes
    (episode,) = (item for item in dataset.read(DATA / "recording.h5").episodes if item.name == "controlled_1_1")
    columns = TRUCK.indices(release.manifest.sensors)
    rows = np.column_stack([episode.series["Cp"][:, columns], episode.previous_action])
    free = np.append(0.0, np.ones(sizes.horizon - 1))

    def means(**changes: float) -> tuple[float, float]:
        weights = np.array(replace(release.manifest.mpc.weights, **changes).as_tuple())
        found = []
        for start in range(0, len(rows) - sizes.window - 1, len(rows) // 50):
            window, plan = rows[start : start + sizes.window], np.zeros(sizes.horizon)
            plan[1] = rows[start + sizes.window, -1]
            step = controller.control_step(window, plan, free, weights)
            found.append((np.abs(step.forces[:, 1]).mean(), (step.plan**2).mean()))
        lift, effort = np.mean(found, axis=0)
        return float(lift), float(effort)

    lifts = [means(lift=value)[0] for value in (0.0, 0.5, 2.0)]
    efforts = [means(effort=value)[1] for value in (0.0, 20.0, 100.0)]
    assert lifts == sorted(lifts, reverse=True) and lifts[2] < 0.97 * lifts[0]
    assert efforts == sorted(efforts, reverse=True) and efforts[2] < 0.97 * efforts[0]


@pytest.mark.skipif(shutil.which("openssl") is None, reason="needs the openssl command")
def test_openssl_agrees_about_the_signature(tmp_path: Path) -> None:
    """The check that `docs/reference/release-bundle.md` shows, with a program that knows nothing of this one."""
    signature = (RELEASE / "manifest.sig").read_text(encoding="ascii").split()[-1]
    (tmp_path / "raw").write_bytes(bytes.fromhex(signature))
    key = ROOT / "contract" / "release" / "release.pub"
    command = ["openssl", "pkeyutl", "-verify", "-pubin", "-inkey", str(key), "-rawin"]
    command += ["-sigfile", str(tmp_path / "raw"), "-in"]
    manifest = RELEASE / "manifest.json"
    (tmp_path / "altered").write_bytes(manifest.read_bytes() + b" ")
    assert subprocess.run([*command, str(manifest)], capture_output=True, check=False).returncode == 0
    assert subprocess.run([*command, str(tmp_path / "altered")], capture_output=True, check=False).returncode != 0


def test_the_shown_figures_are_this_releases() -> None:
    figures = json.loads((ROOT / "results" / "demo.json").read_text(encoding="utf-8"))["figures"]
    assert bundle.load(RELEASE).digest[:12] in figures["controller"]
    # A drag reduction counts only while the side force does not grow.
    assert figures["abs_Cl_controlled"] <= figures["abs_Cl_uncontrolled"]
