"""`stillwake bench serve`: what it offers where something is missing, its errors in one line, and how it ends."""

import importlib.util
import signal
import socket
import subprocess
import sys
import urllib.request
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import psutil
import pytest

from contract.config.loading import load_config
from contract.shipped import BUNDLE
from firmware_sim.ecu.stepped import LoopEcu
from firmware_sim.live.setting_words import changes as changes_of
from firmware_sim.live.settings import LiveSettings
from stillwake.parts import live_parts
from stillwake.parts.live_parts import COMPILING, MAKING, Ecus, LiveLoop, controllers, plants
from stillwake.parts.releases import open_release

PATIENCE_S = 120.0


def missing_of(choices, name: str) -> str | None:
    return next(choice["missing"] for choice in choices if choice["name"] == name)


def test_here_everything_can_be_chosen():
    offered = [*controllers(open_release(None, None), None), *plants()]
    assert [choice["name"] for choice in offered] == ["int8", "c", "cortex-m7", "off", "wake", "recording"]
    assert [choice["missing"] for choice in offered] == [None] * 6


def test_the_label_of_the_controller_names_kind_and_precision_of_the_bundle():
    release = open_release(None, None)
    for changes, label in (
        ({"precision": "int8"}, "ECU in Python, int8 ONNX graph"),
        ({"precision": "float32"}, "ECU in Python, float32 ONNX graph"),
        ({"precision": "float32", "kind": "linear"}, "ECU in Python, linear controller, float32"),
    ):
        manifest = SimpleNamespace(**{"is_linear": changes.get("kind") == "linear", **changes})
        other: Any = SimpleNamespace(manifest=manifest, digest=release.digest)
        (shown, *_) = controllers(other, None)
        assert shown["label"] == label
        # What a viewer sets is listed by the same words.
        before, now = LiveSettings(controller="off"), LiveSettings(controller="int8")
        texts = list(changes_of(before, now, release.manifest.mpc.weights, {shown["name"]: shown["label"]}))
        assert texts == [f"controller: {label}"]


def test_a_choice_names_the_extra_that_it_lacks(monkeypatch):
    find, lacking = importlib.util.find_spec, ""
    monkeypatch.setattr(importlib.util, "find_spec", lambda asked: None if asked == lacking else find(asked))
    for lacking, name, extra in (
        ("torch", "c", "train"),
        ("onnx", "cortex-m7", "train"),
        ("unicorn", "cortex-m7", "mcu"),
    ):
        offered = controllers(open_release(None, None), None)
        assert f"stillwake[{extra}]" in str(missing_of(offered, name)), lacking
        assert missing_of(offered, "int8") is None, lacking


def test_the_library_of_a_bundle_of_ones_own_must_be_named(short_release):
    release = open_release(short_release, None)
    assert "--library" in str(missing_of(controllers(release, None), "c"))
    assert missing_of(controllers(release, Path("any")), "c") is None


def test_without_compiler_there_is_no_ecu_in_c_on_this_machine(monkeypatch):
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr("firmware_sim.in_c.compiler.zig_compiler", lambda: None)
    assert "compiler" in str(missing_of(controllers(open_release(None, None), None), "c"))


@pytest.fixture
def told(monkeypatch) -> list[str]:
    """What viewers are told while ECUs in C are made, without making any."""

    @contextmanager
    def library_folder(given):
        yield given

    def loop_ecu(name, sources):
        return LoopEcu(ecu=SimpleNamespace(), kind=name, computed_by="")

    monkeypatch.setattr(live_parts, "library_folder", library_folder)
    monkeypatch.setattr("firmware_sim.in_c.c_ecu.ecu_sources", lambda *_: {})
    monkeypatch.setattr("firmware_sim.bench.ecus.loop_ecu", loop_ecu)
    return []


def test_an_ecu_in_c_is_made_once_and_each_wait_is_told(told):
    release = open_release(None, None)
    ecus = Ecus(release, load_config(), None, told.append)
    assert ecus("c") is ecus("c")
    ecus("cortex-m7")
    assert told == [MAKING, COMPILING["c"], COMPILING["cortex-m7"]]


HELLO = {"controllers": [{"name": "c", "missing": None}, {"name": "cortex-m7", "missing": "the extra mcu"}]}


def test_the_loop_goes_on_while_an_ecu_in_c_is_made_and_waits_for_nothing_else(told):
    release = open_release(None, None)

    def looped() -> tuple[Any, Ecus]:
        ecus = Ecus(release, load_config(), None, told.append)
        return LiveLoop(SimpleNamespace(hello=lambda: HELLO, step=None, handle=None, messages=None), ecus), ecus  # type: ignore[arg-type]

    wanted: tuple[dict[str, Any], ...] = ({"set": {"controller": "c"}}, {"query": "noise=0.1&controller=c"})
    for asked in wanted:
        told.clear()
        loop, ecus = looped()
        work = loop.before(asked)
        assert told == [], asked
        assert work is not None, asked
        work()
        assert loop.before(asked) is None, asked
        assert ecus("c").kind == "c", asked
        assert len(told) == 2, asked
    others: tuple[dict[str, Any], ...] = (
        *({"set": {"controller": name}} for name in ("int8", ["c"], "cortex-m7")),
        *({"set": "c"}, {"query": "enable=c"}, {"query": 3}, {"clear": True}),
    )
    for other in others:
        assert looped()[0].before(other) is None, other


def test_errors_are_one_line_and_leave_nothing(cli, tmp_path, monkeypatch):
    for arguments, says in [
        (("--controller", "m7"), "live setting controller = 'm7': must be one of int8, c"),
        (("--plant", "openfoam"), "must be one of wake, recording"),
        (("--set", "bus.key=k"), "does not use it"),
        (("--set", "mpc.horizon=9"), "does not use it"),
        (("--bundle", "nowhere"), "nowhere"),
        (("--saves", "file"), "it is a file"),
        (("--host", "x" * 300), "no name of a machine"),
    ]:
        monkeypatch.chdir(tmp_path)
        (tmp_path / "file").touch()
        found = cli("bench", "serve", *arguments)
        assert found.code == 1, arguments
        assert says in found.err, arguments
        assert len(found.err.splitlines()) == 1, arguments
        assert [path.name for path in tmp_path.iterdir()] == ["file"], arguments


def test_a_port_in_use_is_one_line_with_what_to_do(cli):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        found = cli("bench", "serve", "--port", taken.getsockname()[1])
    assert found.code == 1
    assert "in use" in found.err
    assert "--port" in found.err
    assert len(found.err.splitlines()) == 1


def test_without_its_extra_it_names_it(cli, monkeypatch):
    for name in [name for name in sys.modules if name.startswith(("firmware_sim.live", "tornado"))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "tornado", None)
    found = cli("bench", "serve")
    assert found.code == 1
    assert "this command needs tornado: pip install 'stillwake[sim]'" in found.err


@pytest.mark.processes
def test_it_serves_a_loop_and_ends_both_processes(tmp_path):
    words = ("bench", "serve", "--port", "0", "--plant", "recording", "--bundle", str(BUNDLE), "--saves", str(tmp_path))
    process = subprocess.Popen(
        [sys.executable, "-m", "stillwake", *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    try:
        url = next(line.strip() for line in process.stdout if line.startswith("http"))
        with urllib.request.urlopen(url, timeout=PATIENCE_S) as response:
            assert b"<!doctype html>" in response.read().lower()
        children = psutil.Process(process.pid).children()
        # To both, as a terminal does.
        for one in (psutil.Process(process.pid), *children):
            one.send_signal(signal.SIGINT)
        out, errors = process.communicate(timeout=PATIENCE_S)
    finally:
        process.kill()
    assert (process.returncode, errors) == (0, "")
    assert out.splitlines()[-1] == "stopped"
    assert psutil.wait_procs(children, timeout=PATIENCE_S)[1] == []
    assert list(tmp_path.iterdir()) == []
