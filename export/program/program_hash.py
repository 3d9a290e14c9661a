"""One hash for a controller program, by which every lowering names its program."""

import hashlib
import json
from dataclasses import asdict
from typing import Any

import numpy as np

from export.program.controller_program import ControllerProgram
from export.program.linear_program import LinearProgram
from export.program.weights import PriorWeights


def program_sha256(program: ControllerProgram | LinearProgram) -> str:
    """SHA-256, in hex, over every weight as a little-endian float64 with its name, and every setting."""
    digest = hashlib.sha256()
    tree: dict[str, Any] = {"scaling": asdict(program.scaling), "mpc": asdict(program.mpc)}
    if isinstance(program, LinearProgram):
        tree |= {"linear": {"model": program.model, "gain": program.gain}}
    else:
        parts = {name: asdict(getattr(program, name)) for name in ("encoder", "dynamics", "decoder")}
        tree |= parts | {"encoder_rows": program.encoder_rows}
        if program.prior is not None:
            tree["prior"] = _of_prior(program.prior)
    settings = {
        **tree,
        "action_limit": program.action_limit,
        "sensors": program.sensors,
        "window": program.window,
    }
    digest.update(json.dumps(settings, sort_keys=True, default=_fingerprint).encode())
    return digest.hexdigest()


def _of_prior(prior: PriorWeights) -> dict[str, Any]:
    """Its tensors, without filters as they were before there were any: so its release keeps its hash."""
    tensors = asdict(prior)
    if prior.knows_speed or not np.array_equal(prior.filters, np.eye(prior.memory)):
        return tensors
    return {"hidden": prior.first, "output": prior.output, "predictor": prior.predictor}


def _fingerprint(value: object) -> str:
    array = np.asarray(value, dtype="<f8")
    return f"{array.shape} {hashlib.sha256(array.tobytes()).hexdigest()}"
