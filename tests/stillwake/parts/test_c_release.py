"""The ECU in C as an export writes it: what it is made of, what it says it goes without, and that it compiles."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from contract.config.loading import load_config
from contract.config.tree import Config
from contract.controller.c_folder import ECU_SETTINGS, library_sources, write_folder
from contract.controller.image_payload import with_layout
from contract.release.bundle import load
from contract.shipped import BUNDLE
from examples.c_samples import MODEL, MPC
from examples.random_programs import random_program
from export.program.random_windows import random_windows
from export.release.lowering import int8_library
from export.to_c.library import c_library
from firmware_sim.in_c.compiler import host_compiler
from stillwake.parts import c_release
from stillwake.parts.c_release import ecu_files

ROWS = np.zeros((10, 5))


def test_an_ecu_checks_no_sensors_without_an_estimator_or_int8_and_says_so(random_release):
    """The shipped release has an estimator, and says that it is int8."""
    lines: list[str] = []
    found = ecu_files(random_release, ROWS, config=Config(), notice=lines.append)
    assert b"#define SW_SENSOR_CHECK 0\n" in found[ECU_SETTINGS]
    release = load(BUNDLE)
    assert c_release._without_check(release, Config(), lines.append) == Config()
    object.__setattr__(release.manifest, "precision", "float32")
    assert not c_release._without_check(release, Config(), lines.append).ecu.sensor_check.enabled
    assert ["does not check the sensors" in line for line in lines] == [True, True]
    assert "--precision int8" in lines[1]


def test_what_c_cannot_do_leaves_the_control_step_alone_and_is_said(random_release):
    lines: list[str] = []
    keyed = replace(Config(), bus=replace(Config().bus, key="bus.key"))
    assert ecu_files(random_release, ROWS, config=keyed, notice=lines.append) == {}
    assert "no ECU in C" in lines[-1]
    assert "bus.key" in lines[-1]
    other = replace(Config(), operating_point=replace(Config().operating_point, width=2.6))
    assert ecu_files(random_release, ROWS, config=other, notice=lines.append) == {}
    assert "operating point" in lines[-1]


def test_examples_are_written_below_the_library_and_not_compiled_into_it(tmp_path, random_release):
    found = ecu_files(random_release, ROWS, config=Config(), notice=lambda line: None)
    library = c_library(random_program(0, model=MODEL, mpc=MPC))
    write_folder(tmp_path / "c", library | found)
    examples = {name for name in found if name.startswith("examples/")}
    assert {item.relative_to(tmp_path / "c").as_posix() for item in (tmp_path / "c" / "examples").iterdir()} == examples
    assert examples
    assert not examples & set(library_sources(found))


@pytest.mark.parametrize(("release", "frames"), [("shipped", "fd"), ("random", "classic")])
@pytest.mark.compiler
def test_the_whole_ecu_compiles_without_a_warning(release, frames, random_release, tmp_path, shared_builds):
    """With a release's estimator and without one; all of it links, so no part is missing."""
    compiler = host_compiler()
    bundle: Path = BUNDLE if release == "shipped" else random_release
    config = load_config()
    config = replace(config, bus=replace(config.bus, frames=frames))
    found = ecu_files(bundle, ROWS, config=config, notice=lambda line: None)
    memory = load(bundle).manifest.window
    program = random_program(0, model=MODEL, mpc=MPC, prior_memory=memory)
    library = int8_library(program, random_windows(program, 4)) | found
    flags = ("-shared", "-fPIC", "-O1", "-ffp-contract=off", "-Wl,--no-undefined")
    shared_builds.compile_c(library_sources(with_layout(library)), tmp_path / "ecu.so", compiler=compiler, flags=flags)
