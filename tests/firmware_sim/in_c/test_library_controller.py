"""A bundle's C library as the controller of a run: its own, or none. What it computes, `tests/parity` compares."""

import html
import json
import shutil
from dataclasses import replace

import pytest

from contract.errors import LibraryError
from firmware_sim.in_c.compiler import OPTIMISED, compiler_version, host_compiler
from firmware_sim.in_c.library_controller import open_library
from tests.each import each
from tests.firmware_sim.ecu_in_c import Exported, exported

try:
    host_compiler()
except LibraryError as error:
    pytest.skip(str(error), allow_module_level=True)


@pytest.fixture(scope="module")
def release(tmp_path_factory) -> Exported:
    return exported(tmp_path_factory.mktemp("library"))


@pytest.mark.proofs  # test_identify.py runs the loop with a library
@pytest.mark.slow  # a whole run with its report
@pytest.mark.usefixtures("no_pictures")
def test_the_command_runs_it_and_reports_it(cli, release, coarse, tmp_path):
    arguments = ["run", tmp_path / "run", "--bundle", release.bundle_path, "--library"]
    (tmp_path / "empty").mkdir()
    for library, words in (("nothing", "No such file"), ("empty", "sw_settings.h is missing")):
        done = cli(*arguments, tmp_path / library)
        assert (done.code, done.err.count("\n")) == (1, 1), done.err
        assert done.err.startswith(f"error: library {tmp_path / library}: ") and words in done.err
        assert not (tmp_path / "run").exists()
    done = cli(*arguments, release.folder, "--lead-in", 0.2, "--controlled", 0.2, "--no-averages", *coarse.words)
    assert done.code == 3  # too short for the window: never in control
    version = compiler_version(host_compiler())
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["computed_by"] == f"C99 int8, {version}, {' '.join(OPTIMISED)}"
    assert summary["computed_by"] in html.unescape((tmp_path / "run" / "report.html").read_text())
    assert version in done.out


@each(
    "file, old, new, words",
    [
        ("sw_settings.h", "#define SW_HORIZON 8", "#define SW_HORIZON 9", "its sizes are not the program's"),
        ("sw_settings.h", "#define SW_DBC_SHA256", '#define SW_DBC_SHA256 "0" //', "another stillwake.dbc"),
        ("sw_settings.h", "#define SW_PRECISION", "#define SW_PRECISE", "SW_PRECISION is missing"),
        ("sw_cost.c", "#include", "#error broken\n#include", "broken"),
    ],
)
def test_an_altered_library_is_refused_in_one_line(release, tmp_path, file, old, new, words):
    folder = tmp_path / "c"
    shutil.copytree(release.folder, folder, dirs_exist_ok=True)
    source = (folder / file).read_text()
    assert old in source
    (folder / file).write_text(source.replace(old, new, 1))
    with pytest.raises(LibraryError, match=words) as refusal:
        open_library(folder, release.bundle, flags=("-O0", "-fsyntax-only"))
    assert "\n" not in str(refusal.value)


def test_the_library_of_another_program_is_refused_in_a_line_that_names_both(release):
    own, another = release.bundle.manifest.program_sha256, "f" * 64
    manifest = replace(release.bundle.manifest, program_sha256=another)
    with pytest.raises(LibraryError, match=rf"(?s)^(?=.*{own[:12]})(?=.*{another[:12]})[^\n]*$"):
        open_library(release.folder, replace(release.bundle, manifest=manifest))
