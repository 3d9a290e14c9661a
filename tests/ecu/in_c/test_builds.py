"""The folder of a C library in the builds of others: CMake, Zephyr, PlatformIO, CMSIS-Pack, each by its own tool."""

import json
import lzma
import re
import shutil
import subprocess
import tarfile
from pathlib import Path

import pytest

pytestmark = [pytest.mark.slow, pytest.mark.compiler]

PAGE = Path(__file__).resolve().parents[3] / "docs" / "how-to" / "integrate-the-ecu.md"
FILES = Path(__file__).with_name("files")
"""`PACK.xsd.xz` is Open-CMSIS-Pack's, 1.7.60; its head has its licence, Apache-2.0."""
NEEDS_CMAKE = pytest.mark.skipif(shutil.which("cmake") is None, reason="cmake is not installed")
STARTED = "reason 0, 2 frames\n"
MODULE = {"name": str, "build": {"cmake": str, "kconfig": str}}
"""Those keys of `METADATA_SCHEMA` in Zephyr's scripts/zephyr_module.py that are used; it allows none but its own."""


def ran(folder: Path, *command: str) -> str:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    return done.stdout


@pytest.fixture
def project(release, tmp_path) -> Path:
    """A fresh folder with what the page shows, the library's beside it."""
    text = PAGE.read_text(encoding="utf-8")
    (rules,) = re.findall(r"```cmake\n(.*?)```", text, re.DOTALL)
    (program,) = (block for block in re.findall(r"```c\n(.*?)```", text, re.DOTALL) if "int main" in block)
    (tmp_path / "CMakeLists.txt").write_text(rules)
    (tmp_path / "main.c").write_text(program)
    shutil.copytree(release.folder, tmp_path / "ecu_c")
    for path in (tmp_path / "ecu_c").rglob("CMakeLists.txt"):
        path.write_text(re.sub(r"-O[23]\b", "-O0", path.read_text()))  # it is to build and to start, not to be fast
    return tmp_path


def sources_of(folder: Path) -> set[str]:
    """What a library may have: every source but the programs."""
    found = {path.relative_to(folder) for path in folder.rglob("*.c")}
    return {path.as_posix() for path in found if path.parts[0] not in ("board", "examples", "replay.c")}


def with_compiler(name: str) -> str:
    """Where it is installed; else with the usual one."""
    return f"-DCMAKE_C_COMPILER={name if shutil.which(name) else 'cc'}"


@NEEDS_CMAKE
def test_the_pages_project_starts(project):
    ran(project, "cmake", "-B", "build", with_compiler("clang"), "-DSW_LOADER=OFF")
    ran(project, "cmake", "--build", "build")
    assert ran(project, "./build/vehicle") == STARTED
    assert not list(project.glob("build/**/libstillwake_loader.a"))


@pytest.mark.proofs  # two builds; the same rules build the page's project
@NEEDS_CMAKE
def test_a_project_starts_that_finds_the_installed_package(project):
    """From a folder that knows nothing of ecu_c; the known answer is left out."""
    ran(project, "cmake", "-Werror=dev", "-B", "build_c", with_compiler("gcc"), "-DSW_KNOWN_ANSWER=OFF", "ecu_c")
    ran(project, "cmake", "--build", "build_c")
    assert "100% tests passed" in ran(project, "ctest", "--test-dir", "build_c")
    ran(project, "cmake", "--install", "build_c", "--prefix", "installed")
    other = project / "other"
    other.mkdir()
    shutil.copy(project / "main.c", other)
    rules = (project / "CMakeLists.txt").read_text()
    found = re.sub(r"add_subdirectory.*", "find_package(stillwake 1 REQUIRED)", rules)
    (other / "CMakeLists.txt").write_text(found.replace("stillwake::ecu", "stillwake::loader stillwake::ecu"))
    ran(other, "cmake", "-B", "build", with_compiler("clang"), f"-DCMAKE_PREFIX_PATH={project / 'installed'}")
    ran(other, "cmake", "--build", "build")
    assert ran(other, "./build/vehicle") == STARTED


@NEEDS_CMAKE
def test_it_is_a_module_of_zephyr(project):
    """By the keys of Zephyr's schema, Kconfig's own parser, and the rules under stand-ins for Zephyr's functions."""
    yaml = pytest.importorskip("yaml")
    folder = project / "ecu_c"
    module = yaml.safe_load((folder / "zephyr" / "module.yml").read_text())
    assert {name: type(value) if name == "name" else {key: type(each) for key, each in value.items()}
            for name, value in module.items()} == MODULE  # fmt: skip
    assert (folder / module["build"]["cmake"] / "CMakeLists.txt").is_file()
    assert (folder / module["build"]["kconfig"]).is_file()
    shutil.copy(FILES / "in_zephyr.cmake", project / "CMakeLists.txt")
    ran(project, "cmake", "-B", "build")
    ran(project, "cmake", "--build", "build")
    assert ran(project, "./build/vehicle") == STARTED


def test_its_kconfig_offers_each_part_behind_what_it_needs(release):
    kconfiglib = pytest.importorskip("kconfiglib", reason="kconfiglib is not installed")
    found = kconfiglib.Kconfig(str(release.folder / "zephyr" / "Kconfig"))
    values = {}
    for given in ({"": "n"}, {"": "y", "_LOADER": "y"}, {"_ECU": "n"}):
        for name, value in given.items():
            found.syms[f"STILLWAKE{name}"].set_value(value)
        values[next(iter(given))] = [found.syms[f"STILLWAKE_{name}"].str_value for name in ("ECU", "LOADER")]
    assert list(values.values()) == [["y", "y"], ["n", "n"]] and not found.warnings


def test_platformio_packs_it_and_takes_its_sources(release, tmp_path, monkeypatch):
    manifest = json.loads((release.folder / "library.json").read_text())
    assert {"name", "version", "description", "keywords", "license"} <= set(manifest)
    chosen = manifest["build"]["srcFilter"]
    assert {entry[2:-1] for entry in chosen[1:]} == sources_of(release.folder)
    schema = pytest.importorskip("platformio.package.manifest.schema", reason="platformio is not installed")
    pack = pytest.importorskip("platformio.package.pack")
    # It would fetch the list of licences.
    licences = {"licenses": [{"licenseId": "MIT"}]}
    monkeypatch.setattr(schema.ManifestSchema, "load_spdx_licenses", staticmethod(lambda: licences))
    with tarfile.open(pack.PackagePacker(str(release.folder)).pack(str(tmp_path / "stillwake.tar.gz"))) as archive:
        assert sources_of(release.folder) <= set(archive.getnames())
    files = pytest.importorskip("platformio.fs")
    assert set(files.match_src_files(str(release.folder), chosen, ["c"])) == sources_of(release.folder)


def test_the_pack_is_as_its_schema_has_it_and_names_every_file(release):
    etree = pytest.importorskip("lxml.etree", reason="lxml is not installed")
    (description,) = release.folder.glob("*.pdsc")
    found = etree.parse(str(description))
    schema = etree.XMLSchema(etree.fromstring(lzma.decompress((FILES / "PACK.xsd.xz").read_bytes())))
    assert schema.validate(found), schema.error_log
    assert description.stem == ".".join(found.findtext(name) for name in ("vendor", "name"))
    files = {each.get("name"): each.get("category") for each in found.iter("file")}
    assert {name for name, category in files.items() if category == "sourceC"} == sources_of(release.folder)
    assert all((release.folder / name).is_file() for name in files)
    conditions = {each.get("id"): [need.get("Cgroup") for need in each] for each in found.iter("condition")}
    groups = {each.get("Cgroup"): conditions.get(each.get("condition"), []) for each in found.iter("component")}
    assert groups == {"controller": [], "ecu": ["controller"], "loader": ["controller", "ecu"]}
    # The schema refuses what it should: a component without a class.
    next(found.iter("component")).attrib.pop("Cclass")
    assert not schema.validate(found)
