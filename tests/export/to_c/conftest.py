"""The sample folders of the C library."""

from functools import partial
from pathlib import Path

import pytest

from ecu.in_c.host_library import CController
from examples import c_samples


@pytest.fixture(scope="session")
def samples(tmp_path_factory) -> Path:
    folder: Path = tmp_path_factory.mktemp("samples") / "c"
    with pytest.MonkeyPatch.context() as patch:
        # One build for the expected answers and for the known one.
        patch.setattr(c_samples, "CController", partial(CController, flags=("-O1", "-ffp-contract=off")))
        c_samples.main(folder)
    return folder
