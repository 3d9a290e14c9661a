"""The C library of the shipped bundle: made from the shipped model when it is needed, and checked to be the same."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import date
from functools import partial
from pathlib import Path

from contract.config.loading import from_tree
from contract.model_folder import read_description
from stillwake.c_release import ecu_files
from stillwake.releases import open_release
from wake.shipped import model, recording


def write_shipped_library(folder: Path) -> None:
    """Write the library of the shipped bundle's program into a folder.

    Raises:
        ExportError: the shipped model does not give the shipped bundle's program.
        StillwakeError: the data are not installed, or the folder cannot be written.
    """
    from export.release.pipeline import export_all

    manifest, source = open_release(None, None).manifest, model()
    config = from_tree(read_description(source)["config"])
    export_all(
        source,
        None,
        precision=manifest.precision,
        name=manifest.name,
        recording=recording(),
        config=config,
        ecu=partial(ecu_files, config=config, notice=lambda line: None),
        c_folder=folder,
        created=date.fromisoformat(manifest.created),
        named=False,
        program_sha256=manifest.program_sha256,
    )


@contextmanager
def library_folder(given: Path | None) -> Iterator[Path]:
    """The folder that was given, or one with the shipped bundle's library that lasts as long as the block."""
    if given is not None:
        yield given
        return
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch, "library")
        write_shipped_library(folder)
        yield folder
