"""Release bundles: lower a program, prove the graph against the reference, write it with its manifest."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from contract.operating_point import OperatingPoint
from contract.release import bundle
from export.gates.parity import ParityReport, check_parity
from export.gates.quantisation import QuantisationLimits, QuantisationReport, check_quantisation, compare_quantised
from export.int8.calibrate import rounded_program
from export.program.controller_program import ControllerProgram
from export.program.program_hash import program_sha256
from export.program.random_program import random_window
from export.program.weights import Array
from export.to_onnx.control_step import build_controller
from export.to_onnx.weights import Precision

_RANDOM_WINDOWS = 20


@dataclass(frozen=True, kw_only=True)
class ReleaseReport:
    """What the gates measured, also found in the manifest's provenance under `export`.

    Attributes:
        controller_bytes: size of `controller.onnx`.
        parity: ONNX graph against the reference at the same weights.
        quantisation: int8 against float weights; None for a float release.
    """

    controller_bytes: int
    parity: ParityReport
    quantisation: QuantisationReport | None


def write_release(
    path: Path,
    program: ControllerProgram,
    *,
    precision: Precision,
    name: str,
    operating_point: OperatingPoint,
    budget_ms: float,
    compute_time_ms: float,
    control_period: float,
    created: date,
    dataset_sha256: str,
    weights_sha256: str,
    provenance: Mapping[str, Any],
    windows: Sequence[Array] | None = None,
    calibration: Sequence[Array] | None = None,
    limits: QuantisationLimits | None = None,
    key: Ed25519PrivateKey | None = None,
) -> ReleaseReport:
    """Write a release bundle (a directory, or a zip if the path ends in .zip), whole or not at all.

    Args:
        precision: "float32" or "int8" (weights).
        name: of the release, for people.
        budget_ms: latest answer after a pressure frame.
        compute_time_ms: what of it is allotted to the control step.
        control_period: in t_c.
        created: today.
        dataset_sha256: of the recording that the program was trained on.
        weights_sha256: of the trained model's tensors.
        provenance: of the training otherwise; the gates' figures are added under `export`.
        windows: recorded windows (L, S+1), consecutive ones, for the gates; random ones if None.
        calibration: other recorded windows, which int8 rounding keeps in view; rounded to nearest if None.
        limits: what int8 weights may change.
        key: to sign the release with; unsigned if None.

    Raises:
        ExportError: the program cannot be lowered, the graph does not compute what the reference does, or int8
            weights change the controller by more than the limits.
        StillwakeError: the path cannot be written.
    """
    if windows is None:
        rng = np.random.default_rng(0)
        windows = [random_window(program, rng) for _ in range(_RANDOM_WINDOWS)]
    effective, quantisation = program, None
    if precision == "int8":
        effective = rounded_program(program, calibration)
        quantisation = compare_quantised(program, effective, windows)
        check_quantisation(quantisation, QuantisationLimits() if limits is None else limits)
    # Rounding what is already rounded changes nothing, so this is the effective program in either precision.
    model = build_controller(effective, precision).SerializeToString()
    report = ReleaseReport(
        controller_bytes=len(model), parity=check_parity(effective, model, windows), quantisation=quantisation
    )
    manifest = bundle.Manifest(
        name=name,
        created=created.isoformat(),
        precision=precision,
        sensors=program.sensors,
        window=program.window,
        control_period=control_period,
        action_limit=program.action_limit,
        operating_point=operating_point,
        mpc=program.mpc,
        scaling=program.scaling,
        budget_ms=budget_ms,
        compute_time_ms=compute_time_ms,
        dataset_sha256=dataset_sha256,
        weights_sha256=weights_sha256,
        program_sha256=program_sha256(effective),
        provenance={**provenance, "export": asdict(report)},
    )
    bundle.write(path, manifest, {bundle.CONTROLLER: model}, key)
    return report
