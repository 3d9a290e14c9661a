"""One hash for a controller program, by which every lowering names its program."""

import hashlib
import json
from dataclasses import asdict
from typing import Any

import numpy as np

from export.program.controller_program import ControllerProgram


def program_sha256(program: ControllerProgram) -> str:
    """SHA-256, in hex, over every weight as a little-endian float64 with its name, and every setting."""
    digest = hashlib.sha256()
    parts = ("scaling", "mpc", "encoder", "dynamics", "decoder")
    settings: dict[str, Any] = {name: asdict(getattr(program, name)) for name in parts}
    settings |= {name: getattr(program, name) for name in ("encoder_rows", "action_limit", "sensors", "window")}
    if program.prior is not None:
        settings["prior"] = asdict(program.prior)
    digest.update(json.dumps(settings, sort_keys=True, default=_fingerprint).encode())
    return digest.hexdigest()


def _fingerprint(value: object) -> str:
    array = np.asarray(value, dtype="<f8")
    return f"{array.shape} {hashlib.sha256(array.tobytes()).hexdigest()}"
