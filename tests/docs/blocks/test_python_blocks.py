"""The Python of the pages runs as it stands, a page's blocks after one another; other tests take some of them over."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from can_bridge.bus.simulated.medium import SimulatedBus
from contract.config.body import BodyConfig
from contract.config.loading import load_config
from contract.config.plant import FlowConfig
from contract.config.tree import Config
from contract.release import bundle
from tests.docs.blocks.fragments import fragment
from tests.docs.blocks.pages import Block, blocks
from tests.docs.blocks.programs import PROGRAMS_ELSEWHERE, SHORTENED
from wake.truck.state import save_state
from wake.truck.truck_wake import TruckWake

Names = dict[str, Any]


def is_run_here(block: Block) -> bool:
    found = fragment(block)
    if block.language == "python":
        return (block.page, "python") not in PROGRAMS_ELSEWHERE
    return found is not None and found.kind == "python"


BLOCKS = [block for block in blocks() if is_run_here(block)]


def bus_of_faults(folder: Path, release: Path) -> Names:
    return {"bus": SimulatedBus(Config().bus), "config": Config(), "SimulatedBus": SimulatedBus}


def run_of_disturbances(folder: Path, release: Path) -> Names:
    wake = TruckWake(FlowConfig(refinement=0.4, substeps=12))
    config = load_config(None, ["flow.refinement=0.4", "flow.substeps=12"])
    return {"bundle": bundle.load(release), "config": config, "wake": wake, "state": wake.state()}


def own_body(folder: Path, release: Path) -> Names:
    """start.npz, as `stillwake develop` writes it, but at rest."""
    body = BodyConfig(length=1.0, leading_edge_radius=0.0, sensors_per_side=20)
    save_state(folder / "start.npz", TruckWake(FlowConfig(reynolds=100.0, substeps=45), body=body).state())
    return {}


def signals(folder: Path, release: Path) -> Names:
    return {"np": np, "h5py": h5py, **dict.fromkeys(("action", "Cd", "Cl"), np.zeros(3)), "Cp": np.zeros((3, 4))}


STAND_INS: dict[str, Callable[[Path, Path], Names]] = {
    "docs/reference/bus-faults.md": bus_of_faults,
    "docs/reference/disturbances.md": run_of_disturbances,
    "docs/reference/environment.md": own_body,
    "docs/how-to/use-your-own-data.md": signals,
}
"""What the prose of a page says is there already."""


@pytest.mark.slow  # the flow is computed
@pytest.mark.parametrize("page", dict.fromkeys(block.page for block in BLOCKS))
def test_they_run(page, tmp_path, monkeypatch, short_release, shared_wake):
    monkeypatch.chdir(tmp_path)
    names = STAND_INS[page](tmp_path, short_release) if page in STAND_INS else {}
    for block in BLOCKS:
        if block.page == page:
            text = block.text
            for written, shorter in SHORTENED:
                text = text.replace(written, shorter)
            # Numbers of lines are the page's, for the traceback.
            exec(compile("\n" * (block.line - 1) + text, page, "exec"), names)


def test_what_is_shortened_is_there():
    for written, _ in SHORTENED:
        assert any(written in block.text for block in BLOCKS), f"no page has {written!r} any more"
