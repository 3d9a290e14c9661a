"""The writer of release bundles. A bundle has lowerings that passed the gates, and a manifest of their assumptions and
origin."""

from dataclasses import asdict
from datetime import date
from pathlib import Path

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from contract.config.tree import Config
from contract.model.model_folder import Provenance
from contract.release import bundle
from contract.release.bundle import MadeEstimator, with_estimator
from contract.release.checks import CONTROLLER, Bundle
from contract.release.manifest import FIRST_SECURITY_VERSION, Manifest, RestingWake, SpeedRange
from contract.runtime.onnx_session import OnnxEstimator
from export.release.gated import Gated


def write_release(
    path: Path,
    gated: Gated,
    *,
    name: str,
    created: date,
    config: Config,
    provenance: Provenance,
    positions: tuple[tuple[float, float], ...] | None = None,
    resting: RestingWake | None = None,
    air_speed: tuple[float, ...] | None = None,
    key: Ed25519PrivateKey | None = None,
    estimator: MadeEstimator | None = None,
) -> None:
    """Write a release bundle, completely or not at all. Raises StillwakeError if the path cannot be written, or
    contains something other than a bundle; BundleControllerError if the estimator is for other sensors or another
    window.

    Args:
        config: settings of the vehicle: operating point, control period, and time that is assigned to a control step.
        provenance: provenance of the training; the gates' figures are added under `export`.
        positions: (x, y) of every sensor in the body's reference length W, if they are known.
        resting: the wake without jets by speed, if it is known.
        air_speed: weights of the estimate of the air speed, if the model has them.
        key: key to sign the release with; the release is unsigned if None.
        estimator: estimator of the release's sensors; without it, the ECU does not check its sensors.
    """
    lowered = gated.lowered
    program = lowered.effective
    # A prior that was trained for the design speed only, and a model without a prior, have no range of speeds.
    refined = provenance.config.get("refine", {})
    slowest, fastest = refined.get("slowest", 1.0), refined.get("fastest", 1.0)
    manifest = Manifest(
        name=name,
        created=created.isoformat(),
        precision=lowered.precision,
        sensors=program.sensors,
        sensor_positions=positions,
        window=program.window,
        action_limit=program.action_limit,
        mpc=program.mpc,
        scaling=program.scaling,
        operating_point=config.operating_point,
        control_period=config.flow.control_period,
        budget_ms=config.period_ns / 1e6,
        compute_time_ms=config.ecu.compute_time_ms,
        dataset_sha256=provenance.dataset_sha256,
        weights_sha256=provenance.weights_sha256,
        program_sha256=lowered.program_sha256,
        provenance={**provenance.training(), "export": asdict(gated.graph)},
        security_version=FIRST_SECURITY_VERSION,
        speeds=SpeedRange(slowest=slowest, fastest=fastest) if slowest < fastest else None,
        resting=resting,
        air_speed=air_speed,
    )
    contents = {CONTROLLER: lowered.graph}
    if estimator is not None:
        manifest = with_estimator(manifest, contents, estimator)
        OnnxEstimator.of(Bundle(manifest=manifest, files=contents, digest=""))
    bundle.write(path, manifest, contents, key)
