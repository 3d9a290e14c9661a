from pathlib import Path

import pytest

from tests.ecu.flashable.vehicle_ecu import UNCHECKED, Rig, image, provision


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    """An ECU with release "first"."""
    provision(tmp_path / "ecu", image("first"))
    return Rig(tmp_path / "ecu", UNCHECKED)
