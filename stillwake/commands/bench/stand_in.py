"""A bundle and its C library with random weights, of the size of a release whose C library is not at hand.

The time of a control step depends on the shapes, not on the weights; what it commands means nothing.
"""

from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from contract.config.tree import Config
from contract.controller.c_folder import write_folder
from contract.model_folder import Provenance
from contract.release import bundle as bundles
from contract.release.bundle import Bundle

SEED: Final = 0
CALIBRATION: Final = 20
"""Random windows that the ranges of int8 activations are taken from."""


class StandIn(NamedTuple):
    """Where it lies."""

    bundle: Path
    library: Path


def write_stand_in(folder: Path, release: Bundle, config: Config) -> StandIn:
    """Write both into a folder that exists.

    Args:
        folder: of both.
        release: whose window, sensors, horizon, iterations, precision and vehicle it takes over.
        config: whose `model` gives the widths of the networks that are deployed.

    Raises:
        LibraryError, ExportError, StillwakeError: it cannot be made or written.
    """
    from export.int8.rounded_program import Program, rounded_to_nearest
    from export.program.program_hash import program_sha256
    from export.program.random_program import random_program, random_window
    from export.release.lowering import lower

    manifest = release.manifest
    model = replace(config.model.slim, window=manifest.window)
    program = random_program(
        SEED, model=model, mpc=manifest.mpc, action_limit=manifest.action_limit, sensors=manifest.sensors
    )
    rng = np.random.default_rng(SEED)
    lowered_from: Program = rounded_to_nearest(program) if manifest.precision == "int8" else program
    windows = [random_window(program, rng) for _ in range(CALIBRATION)]
    lowered = lower(lowered_from, calibration=windows, with_library=True)
    assert lowered.library is not None
    paths = StandIn(folder / "bundle", folder / "library")
    unknown = "0" * 64
    stands_in = replace(
        manifest,
        name=f"random, of the size of {manifest.name}",
        created=date.today().isoformat(),
        scaling=program.scaling,
        program_sha256=program_sha256(lowered.effective),
        dataset_sha256=unknown,
        weights_sha256=unknown,
        provenance=Provenance(
            dataset_sha256=unknown, weights_sha256=unknown, metrics={}, versions={}, config={}
        ).training(),
    )
    # The sensor estimator, if there is one, is the release's own: it has no random twin, and its time counts too.
    bundles.write(paths.bundle, stands_in, {**release.files, bundles.CONTROLLER: lowered.graph}, None)
    write_folder(paths.library, dict(lowered.library))
    return paths
