"""One hash for a controller program, by which every lowering names its program."""

import hashlib
import json
from dataclasses import asdict
from typing import Any

import numpy as np

from export.program.controller_program import ControllerProgram
from export.program.linear_program import LinearProgram


def program_sha256(program: ControllerProgram | LinearProgram) -> str:
    """SHA-256, in hex, over every weight as a little-endian float64 with its name, and every setting."""
    digest = hashlib.sha256()
    tree: dict[str, Any] = {"scaling": asdict(program.scaling), "mpc": asdict(program.mpc)}
    if isinstance(program, LinearProgram):
        tree |= {"linear": {"model": program.model, "gain": program.gain}}
    else:
        parts = ("encoder", "dynamics", "decoder", *(() if program.prior is None else ("prior",)))
        tree |= {name: asdict(getattr(program, name)) for name in parts} | {"encoder_rows": program.encoder_rows}
    settings = {
        **tree,
        "action_limit": program.action_limit,
        "sensors": program.sensors,
        "window": program.window,
    }
    digest.update(json.dumps(settings, sort_keys=True, default=_fingerprint).encode())
    return digest.hexdigest()


def _fingerprint(value: object) -> str:
    array = np.asarray(value, dtype="<f8")
    return f"{array.shape} {hashlib.sha256(array.tobytes()).hexdigest()}"
