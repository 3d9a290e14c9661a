"""Copy a trained model and its release to their places in the checkout, and write the model's provenance.

    python -m benchmarks.release.ship MODEL BUNDLE --command "stillwake train ..."

`make release` calls this module. The module changes nothing unless the bundle was made from the model and signed with
the project's key.
"""

import argparse
import json
import shutil
from datetime import date
from pathlib import Path
from typing import Final

from benchmarks.common.command_line import ROOT
from contract.atomic import replacing
from contract.errors import BundleError
from contract.model.model_folder import DESCRIPTION, MODEL_WEIGHTS, read
from contract.release import bundle as bundles
from contract.release.checks import sha256
from contract.release.signing import project_key
from contract.shipped import BUNDLE

DATA: Final = ROOT / "data" / "stillwake_data"


def ship(model: Path, release: Path, *, command: str, on: date, data: Path = DATA, bundle: Path = BUNDLE) -> None:
    """Replace the shipped model (in `data`, beside its provenance) and bundle. Raises ModelError if the model is
    damaged; BundleError if the bundle is damaged, not signed with the project's key, or made from another model."""
    trained, found = read(model), bundles.load(release, project_key())
    if found.manifest.weights_sha256 != trained.weights_sha256:
        raise BundleError(f"bundle {release} was not made from the model {model}: export it again")
    for source, target in ((model, data / "model"), (release, bundle)):
        shutil.rmtree(target, ignore_errors=True)
        shutil.copytree(source, target)
    path = data / "provenance.json"
    records = json.loads(path.read_text(encoding="utf-8"))
    records["model"] = {
        "command": command,
        "date": on.isoformat(),
        "sha256": {name: sha256((model / name).read_bytes()) for name in (DESCRIPTION, MODEL_WEIGHTS)},
        "recording_sha256": trained.description.dataset_sha256,
        "versions": dict(trained.description.versions),
    }
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(records, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("model", type=Path)
    parser.add_argument("bundle", type=Path)
    parser.add_argument("--command", required=True, help="command that trained the model")
    given = parser.parse_args()
    ship(given.model, given.bundle, command=given.command, on=date.today())
