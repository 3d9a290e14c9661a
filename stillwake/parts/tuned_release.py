"""Controllers with other settings of the optimiser: for the runs of a search, and a release of them to be judged."""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path

from contract.config.controller import MpcConfig
from contract.config.loading import from_tree
from contract.config.tree import Config
from contract.controller.estimator import ESTIMATOR
from contract.controller.interface import RunnableController
from contract.errors import BundleError, DatasetError, ExportError
from contract.model.model_folder import ModelFolder
from contract.release import bundle as bundles
from contract.release.bundle import MadeEstimator
from contract.release.checks import Bundle
from contract.release.manifest import Manifest
from contract.runtime.onnx_session import OnnxController


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelOf:
    """The trained model of a release.

    Attributes:
        folder: where it lies.
        dataset: recording that it was fitted to.
    """

    folder: Path
    model: ModelFolder
    dataset: Path

    @classmethod
    def read(cls, folder: Path, dataset: Path, release: Bundle) -> "ModelOf":
        """Read the model, and see that all three belong together.

        Raises:
            BundleError: the model is another release's.
            DatasetError: the recording is not the model's.
            ModelError: the model is not sound.
        """
        from contract.model import model_folder

        model = model_folder.read(folder)
        if model.weights_sha256 != release.manifest.weights_sha256:
            raise BundleError(
                f"bundle {release.manifest.name!r} is of the model {release.manifest.weights_sha256[:12]}, {folder} is "
                f"{model.weights_sha256[:12]}: name the bundle's own with --model"
            )
        try:
            digest = hashlib.sha256(dataset.read_bytes()).hexdigest()
        except OSError as error:
            raise DatasetError(f"{dataset}: {error.strerror or error}") from error
        if digest != model.description.dataset_sha256:
            own = model.description.dataset_sha256
            raise DatasetError(
                f"{dataset} (SHA-256 {digest[:12]}) is not the recording that the model was fitted to ({own[:12]}): "
                "name that one with --dataset"
            )
        return cls(folder=folder, model=model, dataset=dataset)


def controller_of(release: Bundle, model: ModelOf | None) -> Callable[[MpcConfig], RunnableController]:
    """What makes the controller of settings: the release's own graph, or with a model one of these settings in float32.

    A learning rate or a horizon is fixed in a graph. Without rounding one is made in a tenth of a second.
    """
    if model is None:
        controller = OnnxController.of(release)
        return lambda mpc: controller

    from export.program.from_training import program_of
    from export.to_onnx.control_step import build_controller

    program = program_of(model.model, release.manifest.mpc)
    manifest = release.manifest

    def made(mpc: MpcConfig) -> RunnableController:
        graph = build_controller(replace(program, mpc=mpc)).SerializeToString()
        return OnnxController(graph, replace(manifest, mpc=mpc).sizes)

    return made


def release_of(release: Bundle, mpc: MpcConfig, model: ModelOf | None, folder: Path, today: date) -> Bundle:
    """A release with these settings, as it would be made for a vehicle.

    Where only weights differ it is the release itself with others in its manifest; else it is exported to the folder,
    rounded and gated, and has the old one's sensor estimator.

    Raises:
        ExportError: a gate refuses the settings, such as that of the rounding.
    """
    old = release.manifest.mpc
    if replace(mpc, weights=old.weights) == old:
        return replace(release, manifest=replace(release.manifest, mpc=mpc))
    assert model is not None, "a release without its model is tuned in its weights alone"
    if not (folder.exists() and bundles.load(folder).manifest.mpc == mpc):
        from export.release.pipeline import export_all

        export_all(
            model.folder,
            folder,
            precision=release.manifest.precision,
            name=f"{release.manifest.name}-tuned",
            recording=model.dataset,
            config=_config_of(model, release, mpc),
            created=today,
            estimator=_kept_estimator(release),
        )
    return bundles.load(folder)


def first_exported(
    release: Bundle, better: Mapping[int, MpcConfig], source: ModelOf | None, folder: Path, today: date
) -> tuple[tuple[int, Bundle] | None, dict[int, str]]:
    """The first settings of which a release can be made, with their trial and that release; what it skipped, and why.

    Args:
        better: settings by the number of their trial, best first.
        source, folder, today: as `release_of` has them.
    """
    skipped = dict[int, str]()
    for number, mpc in better.items():
        try:
            return (number, release_of(release, mpc, source, folder, today)), skipped
        except ExportError as error:
            skipped[number] = str(error)
    return None, skipped


def _config_of(model: ModelOf, release: Bundle, mpc: MpcConfig) -> Config:
    config = from_tree(dict(model.model.config_tree))
    point = release.manifest.operating_point
    ecu = replace(config.ecu, compute_time_ms=release.manifest.compute_time_ms)
    return replace(config, mpc=mpc, operating_point=point, ecu=ecu)


def _kept_estimator(release: Bundle) -> Callable[[Manifest], MadeEstimator] | None:
    """It reads pressures, which the optimiser's settings do not change."""
    figures = release.manifest.sensor_estimator
    if figures is None:
        return None
    origin = release.manifest.provenance.get("sensor_estimator", {})
    return lambda manifest: MadeEstimator(graph=release.files[ESTIMATOR], figures=figures, provenance=origin)
