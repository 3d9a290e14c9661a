"""A linear model on disk: a directory of `model.safetensors` and `linear_model.json`, whole or not there.

`model.safetensors` holds, with L rows of memory, p differences and rows (y_k, a_k), oldest first:

    model  (p + 1, L, p + 1)  the differences y_{k+1} and Cl_{k+1} from the history up to a_k
    gain   (L, p + 1)         a_k = clip(gain . history); the entry of a_k itself is 0

`linear_model.json` holds what they assume and where they come from:

    schema, config (all settings), sensors (pairs of mirror images), positions, scaling (of these sensors),
    identification, design, metrics, dataset_sha256, weights_sha256, versions
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Final

import numpy as np

from contract.arrays import Array
from contract.config.loading import to_tree
from contract.config.tree import Config
from contract.errors import ConfigError, ModelError
from contract.model.model_folder import Provenance
from contract.model.tensor_folder import WEIGHTS as WEIGHTS
from contract.model.tensor_folder import FolderKind
from contract.release.manifest import LINEAR, Scaling
from contract.typed import typed

SCHEMA: Final = "stillwake-linear-model/1"
DESCRIPTION: Final = "linear_model.json"
KIND: Final = FolderKind(
    noun="a linear model",
    description=DESCRIPTION,
    schemas=(SCHEMA,),
    entries=(
        *("config", "sensors", "positions", "scaling", "identification", "design", "metrics"),
        *("dataset_sha256", "versions"),
    ),
)
is_linear, check_free = KIND.is_at, KIND.check_free


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearDescription:
    """What the numbers assume and where they come from.

    Attributes:
        config: all settings; control period and limit of the jets are those of the recording.
        sensors: pairs of mirror images, one after the other; a difference is first minus second.
        positions: (x, y) of each, in the body's reference length W.
        scaling: mean and deviation of these sensors, the action and the forces where the model was identified. The mean
            Cd is the drag that the controller predicts.
        identification, design: the arguments by which the model was made.
    """

    config: Config
    sensors: tuple[str, ...]
    positions: tuple[tuple[float, float], ...]
    scaling: Scaling
    identification: Mapping[str, Any]
    design: Mapping[str, Any]
    metrics: Mapping[str, Any]
    dataset_sha256: str
    versions: Mapping[str, str]


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearModelFolder:
    """A verified directory; shapes of model and gain as at the top."""

    description: LinearDescription
    model: Array
    gain: Array
    weights_sha256: str
    config_tree: Mapping[str, Any]

    @property
    def provenance(self) -> Provenance:
        """As a release made of the model keeps it, which is marked as linear."""
        about = self.description
        return Provenance(
            dataset_sha256=about.dataset_sha256,
            weights_sha256=self.weights_sha256,
            metrics=about.metrics,
            versions=about.versions,
            config=self.config_tree,
            more={"kind": LINEAR, "identification": about.identification, "design": about.design},
        )


def write(path: Path, description: LinearDescription, model: Array, gain: Array) -> None:
    """Write the directory, replacing a linear model that is there. Raises StillwakeError if the place cannot be written
    or holds something else."""
    config, scaling = to_tree(description.config), asdict(description.scaling)
    entries = {**vars(description), "config": config, "scaling": scaling}
    KIND.write(path, entries, {"model": model, "gain": gain})


def read(path: Path) -> LinearModelFolder:
    """Read and verify a directory. Raises ModelError if a file is missing, damaged, altered or of another schema, or
    the numbers do not fit each other."""
    body, tensors = KIND.read(path)
    description = _describe(path, body)
    if set(tensors) != {"model", "gain"}:
        raise ModelError(f"model {path}: {WEIGHTS} holds {sorted(tensors)}: must be gain and model")
    columns = len(description.sensors) // 2 + 1
    model, gain = (np.asarray(tensors[name], dtype=np.float64) for name in ("model", "gain"))
    if gain.ndim != 2 or gain.shape[1] != columns or model.shape != (columns, *gain.shape):
        raise ModelError(
            f"model {path}: {WEIGHTS}: model {model.shape} and gain {gain.shape} do not fit each other and "
            f"{len(description.sensors)} sensors"
        )
    if not (np.isfinite(model).all() and np.isfinite(gain).all()) or gain[-1, -1] != 0.0:
        raise ModelError(f"model {path}: {WEIGHTS}: a number is not finite, or the gain has one for its own action")
    return LinearModelFolder(
        description=description,
        model=model,
        gain=gain,
        weights_sha256=body["weights_sha256"],
        config_tree=body["config"],
    )


def _describe(path: Path, body: Mapping[str, Any]) -> LinearDescription:
    try:
        return typed({item.name: body[item.name] for item in fields(LinearDescription)}, LinearDescription)
    except ConfigError as error:
        raise ModelError(f"model {path}: {DESCRIPTION}: {error}") from error
