"""What the pages' commands share: a bundle, and the folder of a run."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from contract.config.loading import load_config
from contract.release import bundle
from firmware_sim.bench.closed_loop import run_closed_loop
from firmware_sim.runs.run_folder import RunFolder
from firmware_sim.runs.run_page.report import write_report
from tests.conftest import Coarse
from tests.docs.blocks.given import Shared


@pytest.fixture(autouse=True)
def _sketched(monkeypatch: pytest.MonkeyPatch, no_pictures: None) -> None:
    """What a command computes on a coarse mesh need not be sound; the run that all share has its pictures."""
    monkeypatch.setattr("wake.plants.SETTLE_TIME", 0.4)


@pytest.fixture(scope="session")
def shared(short_release: Path, tmp_path_factory: pytest.TempPathFactory, coarse: Coarse) -> Shared:
    """The run is of 20 t_c on a coarse mesh."""
    place = tmp_path_factory.mktemp("pages") / "run"
    release = bundle.load(short_release)
    config = replace(load_config(None, ["flow.refinement=0.4", "flow.substeps=12"]), mpc=release.manifest.mpc)
    spans: dict[str, Any] = {"lead_in": 7.0, "controlled": 13.0, "settle": 0.0, "averages": False}
    run_closed_loop(place, release, config, plant=coarse.plant(), **spans)
    write_report(RunFolder(place))
    return Shared(bundle=short_release, run=place)
