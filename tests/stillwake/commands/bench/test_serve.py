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
from stillwake.parts import live_parts
from stillwake.parts.live_parts import COMPILING, MAKING, Ecus, LiveLoop, controllers, plants
from stillwake.parts.releases import open_release

PATIENCE_S = 120.0


def missing_of(choices, name: str) -> str | None:
    return next(choice["missing"] for choice in choices if choice["name"] == name)


def test_here_everything_can_be_chosen_by_a_label_with_the_bundles_kind_and_precision():
    release = open_release(None, None)
    offered = [*controllers(release, None), *plants()]
    assert [choice["name"] for choice in offered] == ["int8", "c", "cortex-m7", "off", "wake", "recording"]
    assert [choice["missing"] for choice in offered] == [None] * 6
    for changes, label in (
        ({"precision": "int8"}, "Python, int8 ONNX graph"),
        ({"precision": "float32"}, "Python, float32 ONNX graph"),
        ({"precision": "float32", "kind": "linear"}, "Python, linear, float32"),
    ):
        manifest = SimpleNamespace(**{"is_linear": changes.get("kind") == "linear", **changes})
        other: Any = SimpleNamespace(manifest=manifest, digest=release.digest)
        (shown, *_) = controllers(other, None)
        assert shown["label"] == label


def test_a_choice_names_the_extra_that_it_lacks(monkeypatch):
    find, lacking = importlib.util.find_spec, ""
    monkeypatch.setattr(importlib.util, "find_spec", lambda asked: None if asked == lacking else find(asked))
    for lacking, name, extra in (
        ("torch", "c", "train"),
        ("onnx", "cortex-m7", "train"),
        ("unicorn", "cortex-m7", "mcu"),
    ):
        offered = controllers(open_release(None, None), None)
        assert f"pip install '.[{extra}]'" in str(missing_of(offered, name)), lacking
        assert missing_of(offered, "int8") is None, lacking


def test_an_ecu_in_c_needs_the_bundles_library_and_a_compiler(short_release, monkeypatch):
    release = open_release(short_release, None)
    assert "--library" in str(missing_of(controllers(release, None), "c"))
    assert missing_of(controllers(release, Path("any")), "c") is None
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


def test_errors_are_one_line_and_leave_nothing(all_refused, tmp_path):
    (tmp_path / "file").touch()
    all_refused(
        "bench serve",
        {
            "--controller m7": "live setting controller = 'm7': must be one of int8, c",
            "--plant openfoam": "must be one of wake, recording",
            "--set bus.key=k": "does not use it",
            "--set mpc.horizon=9": "does not use it",
            "--bundle nowhere": "nowhere",
            "--saves file": "it is a file",
            f"--host {'x' * 300}": "no name of a machine",
        },
    )


def test_a_port_in_use_is_one_line_with_what_to_do(refused):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        line = refused("bench", "serve", "--port", taken.getsockname()[1])
    assert "in use" in line
    assert "--port" in line


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
