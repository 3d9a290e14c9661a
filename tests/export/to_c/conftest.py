"""The sample folders of the C library."""

from pathlib import Path

import pytest

from examples.c_samples import main


@pytest.fixture(scope="session")
def samples(tmp_path_factory) -> Path:
    folder: Path = tmp_path_factory.mktemp("samples") / "c"
    main(folder)
    return folder
