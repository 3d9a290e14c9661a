"""A bundle's C library as the controller of a run: its own, or none. What it computes, `tests/parity` compares."""

import html
import json
import shutil
from dataclasses import replace

import pytest

import stillwake.__main__
from contract.errors import LibraryError
from firmware_sim.in_c.compiler import OPTIMISED, compiler_version, host_compiler
from firmware_sim.in_c.library_controller import open_library
from tests.firmware_sim.ecu_in_c import Exported, exported

try:
    host_compiler()
except LibraryError as error:
    pytest.skip(str(error), allow_module_level=True)


@pytest.fixture(scope="module")
def release(tmp_path_factory) -> Exported:
    return exported(tmp_path_factory.mktemp("library"))


@pytest.mark.slow  # a whole run with its report
@pytest.mark.usefixtures("no_pictures")
def test_the_command_runs_it_and_says_so(release, monkeypatch, capsys, tmp_path):
    arguments = ["run", tmp_path / "run", "--bundle", release.bundle_path, "--library", release.folder]
    spans = ["--lead-in", "0.2", "--controlled", "0.2", "--no-averages"]
    monkeypatch.setattr("sys.argv", ["stillwake", *map(str, arguments), *spans])
    with pytest.raises(SystemExit) as stop:
        stillwake.__main__.main()
    # Too short for the window: never in control.
    assert stop.value.code == 3
    version = compiler_version(host_compiler())
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["computed_by"] == f"C99 int8, {version}, {' '.join(OPTIMISED)}"
    assert summary["computed_by"] in html.unescape((tmp_path / "run" / "report.html").read_text())
    assert version in capsys.readouterr().out


def test_the_library_of_another_program_is_refused_in_a_line_that_names_both(release):
    own, another = release.bundle.manifest.program_sha256, "f" * 64
    manifest = replace(release.bundle.manifest, program_sha256=another)
    with pytest.raises(LibraryError) as refusal:
        open_library(release.folder, replace(release.bundle, manifest=manifest))
    assert own[:12] in str(refusal.value)
    assert another[:12] in str(refusal.value)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("#define SW_HORIZON 8", "#define SW_HORIZON 9", "its sizes are not the program's"),
        ("#define SW_DBC_SHA256", '#define SW_DBC_SHA256 "0" //', "another stillwake.dbc"),
        ("#define SW_PRECISION", "#define SW_PRECISE", "SW_PRECISION is missing"),
    ],
)
def test_an_altered_header_is_refused(release, tmp_path, old, new, said):
    folder = tmp_path / "c"
    shutil.copytree(release.folder, folder)
    header = (folder / "sw_settings.h").read_text()
    assert old in header
    (folder / "sw_settings.h").write_text(header.replace(old, new))
    with pytest.raises(LibraryError, match=said):
        open_library(folder, release.bundle)


def test_sources_that_do_not_compile_are_one_line(release, tmp_path):
    folder = tmp_path / "c"
    shutil.copytree(release.folder, folder)
    (folder / "sw_cost.c").write_text("#error broken\n#error again\n")
    with pytest.raises(LibraryError, match="broken") as refusal:
        open_library(folder, release.bundle, flags=("-O0",))
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(("library", "said"), [("nothing", "No such file"), ("empty", r"sw_settings.h is missing")])
def test_the_command_refuses_a_folder_that_is_no_library(monkeypatch, capsys, tmp_path, release, library, said):
    (tmp_path / "empty").mkdir()
    arguments = ["run", tmp_path / "run", "--bundle", release.bundle_path, "--library", tmp_path / library]
    monkeypatch.setattr("sys.argv", ["stillwake", *map(str, arguments)])
    with pytest.raises(SystemExit) as stop:
        stillwake.__main__.main()
    line = capsys.readouterr().err
    assert stop.value.code == 1
    assert line.startswith(f"error: library {tmp_path / library}: ")
    assert said in line
    assert line.count("\n") == 1
    assert not (tmp_path / "run").exists()
