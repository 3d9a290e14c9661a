"""What a user can cause ends in one line and a status; what only we can cause keeps its traceback."""

import errno
import importlib
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest

from contract.errors import ConfigError
from stillwake.console.endings import EXTRAS, REPORT, missing, status_of
from stillwake.console.own_rooms import HOME, ROOMS

PROJECT = tomllib.loads((HOME / "pyproject.toml").read_text(encoding="utf-8"))


def raising(error: BaseException) -> Callable[[], None]:
    def command() -> None:
        raise error

    return command


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (ConfigError("ecu.x = 1: must be 2"), "ecu.x = 1: must be 2"),
        (ConfigError("a\nb\x1b[2J [/x] \udcff"), "a b\\x1b[2J [/x] \\udcff"),
        (OSError(errno.ENOSPC, "No space left on device", "/x/[a].npz"), "/x/[a].npz: No space left on device"),
        (FileNotFoundError(errno.ENOENT, "No such file or directory", b"/\xff"), "/\\udcff: No such file or directory"),
        (OSError("timed out"), "timed out"),
        (TimeoutError(), "TimeoutError"),
        (MemoryError(), "not enough memory"),
        (MemoryError("Unable to allocate 1 PiB"), "not enough memory: Unable to allocate 1 PiB"),
        (ModuleNotFoundError("no torch", name="torch"), "this command needs torch: pip install 'stillwake[train]', or in a checkout pip install '.[train]' ./data"),  # noqa: E501
        (SystemExit("as text"), "as text"),
    ],
)  # fmt: skip
def test_what_a_user_can_cause_is_one_line(capsys, error, line):
    assert status_of(raising(error)) == 1
    assert capsys.readouterr().err == f"error: {line}\n"


@pytest.mark.parametrize(("code", "status"), [(None, 0), (0, 0), (2, 2)])
def test_an_exit_keeps_its_status(capsys, code, status):
    assert status_of(raising(SystemExit(code))) == status
    assert capsys.readouterr().err == ""


def test_ctrl_c_is_one_line(capsys):
    assert status_of(raising(KeyboardInterrupt())) == 130
    assert capsys.readouterr().err == "stopped\n"


@pytest.mark.parametrize("error", [ValueError("a bug"), RecursionError("deep"), AssertionError()])
def test_a_fault_of_ours_keeps_its_traceback(capsys, error):
    assert status_of(raising(error)) == 1
    err = capsys.readouterr().err
    assert err.startswith("Traceback")
    assert type(error).__name__ in err
    assert err.endswith(f"error: {REPORT}\n")


@pytest.mark.parametrize(
    ("module", "line"),
    [
        ("numba", "pip install 'stillwake[sim]', or in a checkout pip install '.[sim]' ./data"),
        ("scipy.sparse.linalg", "this command needs scipy: pip install 'stillwake[sim]'"),
        ("unicorn", "pip install 'stillwake[mcu]'"),
        ("msgpack", "pip install 'stillwake[bus]'"),
        ("nothing_of_ours", "this command needs nothing_of_ours, which is not installed"),
    ],
)
def test_an_extra_is_blamed_only_for_its_own_packages(monkeypatch, module, line):
    for name in [name for name in sys.modules if name.partition(".")[0] == module.partition(".")[0]]:
        monkeypatch.delitem(sys.modules, name)
    assert line in missing(module)


@pytest.mark.parametrize(("command", "extra"), [("export", "train"), ("mcu", "train"), ("dataset", "sim"), ("", "sim")])
def test_of_two_extras_the_one_that_the_command_needs_is_named(monkeypatch, command, extra):
    monkeypatch.delitem(sys.modules, "h5py", raising=False)
    assert f"pip install 'stillwake[{extra}]'" in missing("h5py.version", command)


def test_a_package_without_that_module_is_named(tmp_path, monkeypatch):
    (tmp_path / "shapely_of_mine.py").write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    importlib.import_module("shapely_of_mine")
    line = missing("shapely_of_mine.deeper")
    assert line == (
        f"{tmp_path}/shapely_of_mine.py has no module 'shapely_of_mine.deeper': "
        "is it another version, or a file of that name?"
    )


def test_the_extras_are_the_projects():
    imported_as = {"pillow": "PIL", "pyelftools": "elftools", "can-isotp": "isotp"}
    declared = PROJECT["project"]["optional-dependencies"]
    for extra in EXTRAS.keys() - {"bus"}:
        names = {re.split(r"[^\w-]", requirement)[0] for requirement in declared[extra]}
        assert {imported_as.get(name, name) for name in names} <= set(EXTRAS[extra])


def test_the_rooms_are_the_projects():
    assert {f"{room}*" for room in ROOMS} == set(PROJECT["tool"]["setuptools"]["packages"]["find"]["include"])


def stillwake(*arguments: str, cwd: Path, **options: object) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(HOME)}
    command = [sys.executable, "-m", "stillwake", *arguments]
    return subprocess.run(command, cwd=cwd, env=environment, text=True, timeout=120.0, check=False, **options)  # type: ignore[call-overload]


@pytest.mark.processes
@pytest.mark.parametrize("name", ["train.py", "contract.py", "wake/__init__.py"])
def test_a_file_that_hides_a_package_of_ours_is_named(tmp_path, name):
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_text("print('my own script')\n")
    done = stillwake("train", "model", cwd=tmp_path, capture_output=True)
    room = name.partition("/")[0].removesuffix(".py")
    line = f"hides the package '{room}' of stillwake: rename it, or call `stillwake` from another folder"
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == f"error: {tmp_path / name} {line}\n"


@pytest.mark.processes
def test_other_files_in_the_working_folder_do_no_harm(tmp_path):
    (tmp_path / "wake").mkdir()  # without __init__.py: a folder of data
    (tmp_path / "data.py").write_text("")
    done = stillwake("--version", cwd=tmp_path, capture_output=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert re.fullmatch(r"stillwake \d+\.\d+\.\d+\S*\n", done.stdout)


@pytest.mark.processes
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a full disk to write to")
@pytest.mark.parametrize("arguments", [["--help"], ["config"], ["bundle", "verify"], ["--version"]])
def test_a_full_disk_is_one_line(tmp_path, arguments):
    with Path("/dev/full").open("w") as full:
        done = stillwake(*arguments, cwd=tmp_path, stdout=full, stderr=subprocess.PIPE)
    assert done.returncode == 1
    assert done.stderr == "error: cannot write to standard output: No space left on device\n"


@pytest.mark.processes
@pytest.mark.parametrize("arguments", [["--help"], ["config"]])
def test_a_reader_that_has_seen_enough_is_no_error(tmp_path, arguments):
    read, write = os.pipe()
    os.close(read)
    done = stillwake(*arguments, cwd=tmp_path, stdout=write, stderr=subprocess.PIPE)
    os.close(write)
    assert done.stderr == ""
    assert done.returncode in (0, 1)


@pytest.mark.processes
def test_a_terminal_without_the_character_gets_it_written_out(tmp_path):
    environment = {**os.environ, "PYTHONPATH": str(HOME), "PYTHONIOENCODING": "ascii"}
    command = [sys.executable, "-m", "stillwake", "config", "bus.channel", "--set", "bus.channel=Zürich", "--toml"]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True)
    assert done.stdout == '[bus]\nchannel = "Z\\xfcrich"\n'
