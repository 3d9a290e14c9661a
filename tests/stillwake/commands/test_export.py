"""`export --c` and `mcu` on a fresh clone: the shipped bundle's library, from the shipped model and no other."""

import json
import re
import shutil
import sys

import pytest

from contract import shipped
from contract.config.loading import load_config
from contract.controller.c_folder import read_recorded, read_sources
from contract.errors import ExportError, StillwakeError
from contract.release import bundle as bundles
from contract.release.checks import dbc_bytes
from contract.release.controller_image import intel_hex, read
from contract.shipped import BUNDLE
from export.int8 import rounded_to_nearest
from firmware_sim.mcu.build import compile_board, read_elf
from firmware_sim.mcu.measure import flash_bytes, linked_ram
from stillwake.console.endings import EXTRAS
from stillwake.parts import c_release
from stillwake.parts.releases import open_release

pytestmark = pytest.mark.compiler

FLASH_BYTES, RAM_BYTES, STACK_BYTES = 144 * 1024, 60 * 1024, 1024
"""Of a board with the shipped bundle compiled in: what it takes, and the RAM's share that is the stack."""
XCP_BYTES = 5 * 1024  # flash that `bus.diagnosis.xcp` adds: 4.1 KiB


def test_the_library_of_the_shipped_bundle_is_of_its_program(printed, refused, tmp_path, monkeypatch):
    """With the extra `c` alone; the folder has what other tools read beside the sources."""
    monkeypatch.setattr("export.release.pipeline.GATE_WINDOWS", 5)  # the release was gated by all when it was made
    monkeypatch.setattr("firmware_sim.fmu.fmu_files.binaries", lambda sources, kind: {})  # compiled by its own tests
    with monkeypatch.context() as patch:
        for name in {name for names in EXTRAS.values() for name in names} - {*EXTRAS["c"]}:
            patch.setitem(sys.modules, name, None)
        words = ("--c", tmp_path / "c", "--image", tmp_path / "release.swi", "--fmu", tmp_path / "ecu.fmu")
        out = printed("export", *words)
    image = read((tmp_path / "release.swi").read_bytes())
    layout = ", ".join(f"0x{byte:02x}" for byte in image.facts.layout)
    assert f"SW_LAYOUT_SHA256 {{{layout}}}" in (tmp_path / "c" / "sw_layout.h").read_text(encoding="ascii")
    release = open_release(None)
    assert release.manifest.name in out and image.digest == release.digest
    for header, name, wanted in (
        ("sw_settings.h", "SW_PROGRAM_SHA256", release.manifest.program_sha256),
        ("sw_settings.h", "SW_SENSOR_NAMES", " ".join(release.manifest.sensors)),
    ):
        stated = re.search(rf'{name} "([^"]+)"', (tmp_path / "c" / header).read_text(encoding="ascii"))
        assert stated is not None and stated.group(1) == wanted
    for name in ("c/sw_ecu_settings.h", "c/board/sw_board.ld", "c/loader/sw_uds_settings.h", "ecu.fmu"):
        assert (tmp_path / name).is_file(), name
    c_release.write_image(tmp_path / "release.hex", tmp_path / "c", release, load_config())
    assert (tmp_path / "release.hex").read_bytes() == intel_hex((tmp_path / "release.swi").read_bytes())
    printed("export", "--for-testers", tmp_path / "own")
    assert (tmp_path / "c/stillwake.dbc").read_bytes() == dbc_bytes()
    for name in ("stillwake.a2l", "stillwake.pdx"):
        assert (tmp_path / "c" / name).read_bytes() == (tmp_path / "own" / name).read_bytes()
    bill = json.loads((tmp_path / "c/sbom.cdx.json").read_text())
    listed = {item["name"]: item for item in bill["components"]}
    folder = tmp_path / "c"
    files = {path.relative_to(folder).as_posix(): path for path in folder.rglob("*") if path.is_file()}
    assert listed.keys() == files.keys() - {"sbom.cdx.json"} | {"monocypher", release.manifest.name}
    assert listed["monocypher"]["version"] == "4.0.3"
    assert files["loader/monocypher_c.h"].read_text().startswith("// Monocypher version 4.0.3\n")
    assert "--overwrite" in refused("export", "--c", tmp_path / "c")
    firmware = read_elf(compile_board(read_sources(tmp_path / "c", board=True)))
    assert flash_bytes(firmware) <= FLASH_BYTES + XCP_BYTES
    assert linked_ram(firmware) <= RAM_BYTES - STACK_BYTES


@pytest.mark.proofs  # emulates some seventy steps of a controller of full size
def test_the_ecu_of_the_shipped_bundle_fits_a_cortex_m7(tmp_path):
    """The whole ECU, on an emulated core: counts are exact, so a tenth of room is enough for another compiler.

    What was promised is more: 12 ms at 480 MHz, 64 KiB of RAM, 1 KiB of stack; of its 144 KiB of flash 143 are used.
    """
    from benchmarks.controller.worst_period import worst_periods

    config, folder = load_config(), tmp_path / "c"
    c_release.write_shipped_library(folder, open_release(None), config)
    sources, rows = read_sources(folder, board=True), read_recorded(folder)
    found = worst_periods(sources, config, rows, drives=("iterations",))
    assert found["worst_ms"]["480"] <= 7.0
    assert found["worst_ms"]["480"] <= found["bound_ms"]["480"] <= 7.7
    assert found["flash_bytes"] <= FLASH_BYTES
    assert found["ram_bytes"] <= RAM_BYTES
    assert found["stack_b"] <= STACK_BYTES
    # The library's doubles, whose work depends on the numbers; the estimate of the air speed takes 5,000 of them.
    assert found["instruction_spread"] <= 66_000


def test_a_bundle_of_another_model_or_program_has_no_library(tmp_path, monkeypatch):
    release = open_release(None)
    other = bundles.load(shutil.copytree(BUNDLE, tmp_path / "other"))
    object.__setattr__(other.manifest, "weights_sha256", "0" * 64)
    with pytest.raises(ExportError, match=rf"{release.manifest.name} was made from the model 000000000000"):
        c_release.write_shipped_library(tmp_path / "c", other, load_config())
    # The model's weights, rounded in another way.
    monkeypatch.setattr("export.release.pipeline.rounded_on", lambda program, windows: rounded_to_nearest(program))
    with pytest.raises(ExportError, match=r"has the program .*, but its model gives .*: export the model to a"):
        c_release.write_shipped_library(tmp_path / "c", release, load_config())
    assert not (tmp_path / "c").exists()


def test_a_setting_that_c_cannot_do_for_this_release_ends_it_before_the_work(refused, tmp_path):
    for words in (("--c", tmp_path / "c"), (shipped.model(), tmp_path / "b", "--for-testers", tmp_path / "d")):
        line = refused("export", *words, "--set", "ecu.delay_steps=99")
        assert "ecu.delay_steps = 99: must be at most" in line


def test_without_the_data_a_line_says_how_to_get_them(tmp_path, monkeypatch):
    monkeypatch.setattr(shipped, "MODEL", tmp_path / "none")
    with pytest.raises(StillwakeError, match=r"the shipped model is not installed: pip install \./data"):
        c_release.write_shipped_library(tmp_path / "c", open_release(None), load_config())
