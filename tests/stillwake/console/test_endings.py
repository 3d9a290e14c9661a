"""What a user can cause ends in one line and a status; what only we can cause keeps its traceback."""

import errno
import importlib
import os
import re
import resource
import subprocess
import sys
import tomllib
from collections.abc import Callable
from concurrent.futures import BrokenExecutor
from functools import partial
from pathlib import Path

import pytest

from contract.errors import ConfigError
from stillwake.console.endings import EXTRAS, REPORT, missing, status_of
from stillwake.console.start import HOME, ROOMS, shortage

PROJECT = tomllib.loads((HOME / "pyproject.toml").read_text(encoding="utf-8"))


def raising(error: BaseException) -> Callable[[], None]:
    def command() -> None:
        raise error

    return command


def test_what_a_user_can_cause_is_one_line(capsys):
    damaged = ConfigError("a.npz: damaged")
    damaged.__cause__ = MemoryError()
    for error, line in (
        (ConfigError("ecu.x = 1: must be 2"), "ecu.x = 1: must be 2"),
        (ConfigError("a\nb\x1b[2J [/x] \udcff"), "a b\\x1b[2J [/x] \\udcff"),
        (OSError(errno.ENOSPC, "No space left on device", "/x/[a].npz"), "/x/[a].npz: No space left on device"),
        (FileNotFoundError(errno.ENOENT, "No such file or directory", b"/\xff"), "/\\udcff: No such file or directory"),
        (OSError("timed out"), "timed out"),
        (MemoryError("Unable to allocate 1 PiB"), "not enough memory: Unable to allocate 1 PiB"),
        (ImportError("x.so: failed to map segment"), "not enough memory: x.so: failed to map segment"),
        (RuntimeError("can't start new thread"), "not enough memory: can't start new thread"),
        (damaged, "not enough memory: a.npz: damaged"),
        (BrokenExecutor(), "a worker process ended: it was killed, perhaps because there was not enough memory"),
        (ModuleNotFoundError("no torch", name="torch"), missing("torch")),
        (SystemExit("as text"), "as text"),
    ):
        assert status_of(raising(error)) == 1, error
        assert capsys.readouterr().err == f"error: {line}\n"
    for code, status in ((None, 0), (0, 0), (2, 2)):
        assert status_of(raising(SystemExit(code))) == status, code
        assert capsys.readouterr().err == ""
    # A fault of ours keeps its traceback.
    assert status_of(raising(ValueError("a bug"))) == 1
    err = capsys.readouterr().err
    assert err.startswith("Traceback") and "a bug" in err and err.endswith(f"error: {REPORT}\n")


def test_a_missing_module_names_the_extra_that_brings_it(monkeypatch, tmp_path):
    for module, command, line in (
        ("numba", "", "needs numba: pip install '.[sim]' ./data in a checkout of stillwake"),
        ("nothing_of_ours", "", "this command needs nothing_of_ours, which is not installed"),
        # Of two extras, the one that the command needs.
        ("h5py.version", "export", "pip install '.[c]' ./data"),
        ("h5py.version", "dataset", "pip install '.[sim]'"),
    ):
        with monkeypatch.context() as patch:
            for name in [name for name in sys.modules if name.partition(".")[0] == module.partition(".")[0]]:
                patch.delitem(sys.modules, name)
            assert line in missing(module, command), module
    # A file of the user's in place of the package.
    (tmp_path / "shapely_of_mine.py").write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    importlib.import_module("shapely_of_mine")
    line = f"{tmp_path}/shapely_of_mine.py has no module 'shapely_of_mine.deeper': it may be another version"
    assert missing("shapely_of_mine.deeper").startswith(line)


def test_no_hint_names_a_package_index():
    """stillwake is on none: a line that asks one for it cannot work, and invites others to take the name."""
    for path in (path for folder in (*ROOMS, "benchmarks") for path in (HOME / folder).rglob("*.py")):
        assert not re.search(r"pip install \W?stillwake", path.read_text(encoding="utf-8")), path


def test_extras_and_rooms_are_the_projects():
    imported_as = {"pillow": "PIL", "pyelftools": "elftools", "can-isotp": "isotp", "cyclonedx-python-lib": "cyclonedx"}
    imported_as |= {"mcap-protobuf-support": "mcap_protobuf", "foxglove-schemas-protobuf": "foxglove_schemas_protobuf"}
    declared = PROJECT["project"]["optional-dependencies"]
    for extra in EXTRAS.keys() - {"bus"}:
        names = {re.split(r"[^\w-]", requirement)[0] for requirement in declared[extra]}
        assert {imported_as.get(name, name) for name in names} <= set(EXTRAS[extra])
    assert {f"{room}*" for room in ROOMS} == set(PROJECT["tool"]["setuptools"]["packages"]["find"]["include"])


def test_too_little_memory_is_named_before_the_work(cli, monkeypatch, tmp_path):
    """OpenBLAS would ask for ever. What the command then needs is enough: the number is the one to set."""
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")
    for kind, option, least in ((resource.RLIMIT_AS, "-v", 850 << 10), (resource.RLIMIT_DATA, "-d", 425 << 10)):
        limits = {kind: (1024 * least - 1, resource.RLIM_INFINITY)}
        monkeypatch.setattr(resource, "getrlimit", lambda of, at=limits: at.get(of, (resource.RLIM_INFINITY,) * 2))
        done = cli("run", tmp_path / "out")
        assert (done.code, done.out) == (1, "")
        assert re.fullmatch(
            rf"error: not enough memory: ulimit {option} allows \d+ MB, run needs \d+: set it to {least} or more\n",
            done.err,
        )
        assert cli("run", "--help").code == cli("config").code == 0
        limits[kind] = 1024 * least, resource.RLIM_INFINITY
        assert shortage("run") is None
    assert not any(tmp_path.iterdir())


def test_a_full_disk_behind_the_output_is_one_line_and_a_reader_that_has_gone_is_none(monkeypatch, capsys):
    read, write = os.pipe()
    os.close(read)
    line = "error: cannot write to standard output: No space left on device\n"
    with Path("/dev/full").open("w") as full, os.fdopen(write, "w") as gone:
        for stream, said in ((full, line), (gone, "")):
            with monkeypatch.context() as patch:
                patch.setattr(sys, "stdout", stream)
                assert status_of(lambda: sys.stdout.write("settings")) == 1
            assert capsys.readouterr().err == said


@pytest.mark.processes
def test_where_it_is_called_from_and_where_it_prints_to(tmp_path):
    """In processes: too little memory, an ASCII terminal, a file that hides a package of ours."""

    def stillwake(*words: str, encoding: str = "utf-8", **options: object) -> tuple[int, str, str]:
        environment = {**os.environ, "PYTHONPATH": str(HOME), "PYTHONIOENCODING": encoding}
        options |= {"cwd": tmp_path, "env": environment, "text": True, "capture_output": True}
        done = subprocess.run([sys.executable, "-m", "stillwake", *words], check=False, **options)  # type: ignore[call-overload]
        return done.returncode, done.stdout, done.stderr

    (tmp_path / "wake").mkdir()  # without __init__.py: a folder of data
    (tmp_path / "data.py").write_text("")
    words = ("config", "bus.channel", "--set", "bus.channel=Zürich", "--toml")
    assert stillwake(*words, encoding="ascii") == (0, '[bus]\nchannel = "Z\\xfcrich"\n', "")
    bound = partial(resource.setrlimit, resource.RLIMIT_AS, (90 << 20, 90 << 20))
    status, out, err = stillwake("config", "out", preexec_fn=bound)
    assert (status, out, err.count("\n")) == (1, "", 1)
    assert err.startswith("error: not enough memory: ulimit -v allows 90 MB, ")
    (tmp_path / "wake" / "__init__.py").write_text("print('my own script')\n")
    line = "hides the package 'wake' of stillwake: rename the file, or call `stillwake` from another folder"
    assert stillwake("train", "model") == (1, "", f"error: {tmp_path / 'wake' / '__init__.py'} {line}\n")
