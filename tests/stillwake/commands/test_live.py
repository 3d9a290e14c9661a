"""`stillwake live`: what it offers where something is missing, its errors in one line, and how it ends."""

import importlib.util
import signal
import socket
import subprocess
import urllib.request
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import psutil
import pytest

import contract.shipped
from contract.config.loading import load_config
from contract.shipped import BUNDLE
from ecu.stepped import LoopEcu
from stillwake.parts import live_parts
from stillwake.parts.live_parts import COMPILING, MAKING, Ecus, controllers, plants
from stillwake.parts.releases import open_release
from tests.conftest import STILLWAKE

PATIENCE_S = 120.0


def missing_of(release, library: Path | None = None) -> dict[str, str | None]:
    return {choice["name"]: choice["missing"] for choice in (*controllers(release, library), *plants())}


def test_a_choice_names_what_it_lacks(short_release, monkeypatch):
    shipped, own = open_release(None), open_release(short_release)
    assert missing_of(shipped) == dict.fromkeys(["python", "c", "mcu", "off", "wake", "recording"])
    assert "--library" in str(missing_of(own)["c"])
    assert missing_of(own, Path("any"))["c"] is None
    find, lacking = importlib.util.find_spec, ""
    monkeypatch.setattr(importlib.util, "find_spec", lambda asked: None if asked == lacking else find(asked))
    for lacking, name, extra in (("safetensors", "c", "c"), ("onnx", "mcu", "c"), ("unicorn", "mcu", "mcu")):
        assert f".[{extra}]" in str(missing_of(shipped)[name]), lacking
        assert missing_of(shipped)["python"] is None, lacking
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr("ecu.in_c.compiler.zig_compiler", lambda: None)
    assert "compiler" in str(missing_of(shipped)["c"])
    monkeypatch.setattr(contract.shipped, "_DATA", Path("nowhere"))
    assert "is not installed" in str(plants()[0]["missing"])
    assert plants(Path("own.npz"))[0]["missing"] is None


def test_an_ecu_in_c_is_made_once_and_each_wait_is_told(monkeypatch):
    made: Any = LoopEcu(ecu=SimpleNamespace(), kind="", computed_by="")
    monkeypatch.setattr(live_parts, "library_folder", nullcontext)
    monkeypatch.setattr("ecu.in_c.c_ecu.ecu_sources", lambda *_: {})
    monkeypatch.setattr("firmware_sim.bench.ecus.loop_ecu", lambda name, sources, **_: replace(made, kind=name))
    told = list[str]()
    ecus = Ecus(open_release(None), load_config(), None, told.append)
    assert ecus.ahead("python") is None
    work = ecus.ahead("c")
    assert told == [] and work is not None
    work()
    assert ecus.ahead("c") is None
    assert ecus("c") is ecus("c")
    assert [ecus(name).kind for name in ("c", "mcu")] == ["c", "mcu"]
    assert told == [MAKING, COMPILING["c"], COMPILING["mcu"]]


def test_errors_are_one_line_and_leave_nothing(all_refused):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        rows = {
            "--plant recording --set bus.key=k": "k: cannot read the key",
            "--set mpc.horizon=9": "does not use it",
            "--bundle nowhere": "nowhere",
            f"--host {'x' * 300}": "not the name of a machine",
            f"--port {taken.getsockname()[1]}": "it is in use, perhaps by another `stillwake live`; name",
        }
        all_refused("live", rows)


@pytest.mark.processes
def test_it_serves_a_loop_and_ends_both_processes():
    words = ("live", "--port", "0", "--plant", "recording", "--bundle", str(BUNDLE))
    process = subprocess.Popen([*STILLWAKE, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
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
