"""Every block of code of every page runs as `plan.toml` states, or is listed there with a reason."""

import configparser
import json
import re
import shlex
import shutil
import tomllib
from dataclasses import replace
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
from contract.controller.c_folder import read_sources
from contract.recording import dataset
from contract.release import bundle
from ecu.in_c.compiler import host_compiler
from firmware_sim.bench.closed_loop import run_closed_loop
from firmware_sim.bench.simulation import Spans
from firmware_sim.fmu.fmu_files import ecu_fmu, plant_fmu
from firmware_sim.runs.run_log import RunFolder
from firmware_sim.runs.run_page.report import write_report
from tests.contract.recording.random_episodes import episode
from tests.docs.blocks.given import MAKERS, Shared, begin, give
from tests.docs.blocks.pages import PLAN, ROOT, blocks
from wake.truck.state import save_state
from wake.truck.truck_wake import TruckWake

ALL = blocks()
LINES = [line for block in ALL for line in block.lines]
PROGRAMS = {(one["page"], one["language"]): one for one in PLAN["programs"]}
PYTHON = [
    block
    for block in ALL
    if (block.language == "python" and (block.page, "python") not in PROGRAMS) or block.kind.get("kind") == "python"
]
C = [block for block in ALL if block.language == "c" and (block.page, "c") not in PROGRAMS]
AROUND = {(one["page"], one["begin"]): one for one in PLAN["around"]}


@pytest.fixture(autouse=True)
def _sketched(monkeypatch: pytest.MonkeyPatch, no_pictures: None) -> None:
    """What a command computes on a coarse mesh need not be sound; the run that all share has its pictures."""
    monkeypatch.setattr("wake.plants.SETTLE_TIME", 0.4)


@pytest.fixture(scope="session")
def shared(short_release, release, short_recording, tmp_path_factory, coarse) -> Shared:
    """The run is of 20 t_c on a coarse mesh."""
    place = tmp_path_factory.mktemp("pages") / "run"
    short = bundle.load(short_release)
    config = replace(load_config(None, ["flow.refinement=0.4", "flow.substeps=12"]), mpc=short.manifest.mpc)
    spans = Spans(lead_in=7.0, controlled=13.0, settle=0.0, averages=False)
    run_closed_loop(place, short, config, spans, plant=coarse.plant())
    write_report(RunFolder(place))
    return Shared(bundle=short_release, run=place, library=release.folder, recording=short_recording)


def test_every_line_and_every_other_block_is_planned_for():
    assert len(ALL) > 150 and len(LINES) > 300
    for line in LINES:
        assert line.plan.keys() & {"cannot", "test", "run"}, line
    for block in ALL:
        if block.language:
            known = block.language in ("shell", "python", "c", "toml") or (block.page, block.language) in PROGRAMS
            assert known, f"{block}: what runs it?"
        else:
            assert block.kind, f"{block}: write in plan.toml what this is: {block.first}"


def test_the_plan_has_nothing_that_no_page_has():
    used = [line.plan for line in LINES]
    assert not [one["form"] for one in PLAN["line"] if not any(one is plan for plan in used)]
    assert not [one["begin"] for one in PLAN["block"] if not any(block.kind is one for block in ALL)]
    assert not PROGRAMS.keys() - {(block.page, block.language) for block in ALL}
    assert {(block.page, block.first) for block in C} == AROUND.keys()
    for written, _ in PLAN["shortened"]:
        assert any(written in block.text for block in PYTHON), f"no page has {written!r} any more"


def test_the_tests_that_the_plan_points_to_exist():
    named = [one["test"] for one in PLAN["line"] if "test" in one]
    for name in (*named, *(test for one in PLAN["programs"] for test in one.get("tests", ()))):
        path, _, function = name.partition("::")
        source = (ROOT / path).read_text(encoding="utf-8")
        assert re.search(rf"^def {function}\(", source, re.MULTILINE), f"no test {name}"


def test_settings_options_and_files_of_others_are_read(tmp_path):
    for block in ALL:
        match block.kind.get("kind", block.language):
            case "toml":
                tomllib.loads(block.text)
            case "settings":
                (tmp_path / "page.toml").write_text(block.text, encoding="utf-8")
                load_config(tmp_path / "page.toml", [])
            case "options":
                bare = "\n".join(line.partition("#")[0] for line in block.text.splitlines())
                given = [one.replace(" ", "") for one in re.findall(r"[\w.]+ ?= ?\S+", bare)]
                assert given, block
                load_config(None, given)
            case "ini":
                read = configparser.ConfigParser()
                read.read_string(block.text)
                assert read.sections(), block
            case "json":
                assert all(json.loads(line) for line in block.text.splitlines()), block


@pytest.mark.compiler
def test_c_compiles_without_a_warning(tmp_path, release, shared_builds):
    headers = {path.name: path.read_bytes() for path in release.folder.glob("*.h")}
    for block in C:
        around = AROUND[block.page, block.first]
        page = f"{around['before']}\n{block.text}\n{around['after']}\n".encode()
        contents = headers | {"page.c": page}
        shared_builds.compile_c(contents, tmp_path / "page.o", compiler=host_compiler(), flags=("-c",))


def stand_ins(page: str, folder: Path, short: Path, made: Any) -> dict[str, Any]:
    """What the prose of a page takes for granted."""
    match Path(page).stem:
        case "disturbances":
            wake = TruckWake(FlowConfig(refinement=0.4, substeps=12))
            config = load_config(None, ["flow.refinement=0.4", "flow.substeps=12"])
            wakes = {"bundle": bundle.load(short), "config": config, "wake": wake, "state": wake.state()}
            return wakes | {"bus": SimulatedBus(config.bus), "SimulatedBus": SimulatedBus}
        case "environment":
            # start.npz, as `stillwake develop` writes it, but at rest.
            body = BodyConfig(length=1.0, leading_edge_radius=0.0, sensors_per_side=20)
            save_state(folder / "start.npz", TruckWake(FlowConfig(reynolds=100.0, substeps=45), body=body).state())
        case "use-the-onnx-graph":
            shutil.copytree(short, folder / "runs" / "bundle")
        case "data-set":
            dataset.write(folder / "my.h5", dataset.Dataset(episodes=(episode(),)))
        case "use-the-fmu":
            sources = read_sources(made.folder)
            (folder / "ecu.fmu").write_bytes(ecu_fmu(sources, made.bundle, Config()))
            (folder / "plant.fmu").write_bytes(plant_fmu(Config()))
        case "use-your-own-data":
            signals = dict.fromkeys(("action", "Cd", "Cl"), np.zeros(3))
            return {"np": np, "h5py": h5py, **signals, "Cp": np.zeros((3, 4))}
    return {}


@pytest.mark.slow  # the flow is computed
@pytest.mark.parametrize("page", dict.fromkeys(block.page for block in PYTHON))
def test_python_runs_as_it_stands(page, tmp_path, monkeypatch, short_release, release, shared_wake):
    """The blocks of a page one after another."""
    monkeypatch.chdir(tmp_path)
    names = stand_ins(page, tmp_path, short_release, release)
    for block in PYTHON:
        if block.page == page:
            text = block.text
            for written, shorter in PLAN["shortened"]:
                text = text.replace(written, shorter)
            # Numbers of lines are the page's, for the traceback.
            exec(compile("\n" * (block.line - 1) + text, page, "exec"), names)


def pages_with(run: str) -> list[str]:
    """Pages with a line that runs always, or in `make full` alone."""
    return list(dict.fromkeys(line.page for line in LINES if line.plan.get("run") == run))


# Some hundred commands that run always; all of a page in `make full` alone.
@pytest.mark.parametrize(
    ("page", "runs"),
    [
        *(pytest.param(page, ("always",), marks=pytest.mark.slow) for page in pages_with("always")),
        *(pytest.param(page, ("always", "full"), marks=pytest.mark.pages) for page in pages_with("full")),
    ],
)
def test_command_lines_of_a_page_run(page, runs, tmp_path, monkeypatch, shared, cli):
    """The lines of a page in their order."""
    folder = tmp_path
    monkeypatch.chdir(folder)
    its = [block for block in ALL if block.page == page]
    begin(folder, {block.kind["name"]: block.text for block in its if block.kind.get("kind") == "file"})
    for line in [line for block in its for line in block.lines]:
        plan = line.plan
        if plan.get("run") in runs:
            give(line, folder, shared)
            outcome = cli(*line.call)
            printed = f"{outcome.out[-1500:]}{outcome.err[-1500:]}"
            text = f"{page}: {line.text}\n(run as: {shlex.join(line.call)})\n{printed}"
            assert outcome.code in plan.get("statuses", (0,)), f"status {outcome.code}: {text}"
            if line.goes_to:
                (folder / line.goes_to).write_text(outcome.out, encoding="utf-8")
        if "output" in plan and (plan["run"] not in runs or plan.get("replaced")):
            # What stands for the output of a line.
            name, place = plan["output"]
            path = folder / line.words[place]
            shutil.rmtree(path, ignore_errors=True)
            path.unlink(missing_ok=True)
            path.parent.mkdir(parents=True, exist_ok=True)
            MAKERS[name](path, shared)
