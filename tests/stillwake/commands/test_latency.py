"""`stillwake latency`: what it asks of its processes, its errors in one line, and a short run on a real bus."""

import json
from pathlib import Path

import pytest

from contract.config.loading import load
from contract.errors import ConfigError
from firmware_sim.latency.measured import read_budget
from stillwake.commands.latency import in_real_time
from tests.conftest import STILLWAKE

EXAMPLE = Path(__file__).parents[3] / "examples" / "latency_budget.toml"


def test_the_bus_is_one_of_its_own_unless_named():
    loaded = in_real_time(load())
    assert loaded.config.bus.interface == "udp_multicast"
    assert loaded.config.bus.channel.startswith("239.255.")  # RFC 2365, 6.1: the local scope
    assert loaded.in_overrides == {"bus.interface", "bus.channel"}
    for interface, channel in (("udp_multicast", "239.74.163.9"), ("socketcan", "can0")):
        named = [f"bus.interface={interface}", f"bus.channel={channel}"]
        assert in_real_time(load(overrides=named)).config.bus.channel == channel
    for interface in ("simulated", "virtual"):
        with pytest.raises(ConfigError, match="two processes need a bus between them"):
            in_real_time(load(overrides=[f"bus.interface={interface}"]))


def test_errors_are_one_line_and_leave_nothing(all_refused, short_release):
    assert read_budget(EXAMPLE)["misses_ours"] == 0
    rows = {
        "--set bus.interface=simulated": "two processes need a bus",
        "--set train.sensors=3": "does not use it",
        "--bundle nowhere": "nowhere",
        f"--both --bundle {short_release}": "--both: name the bundle's C library with --library",
    }
    all_refused(("latency", "report"), rows)


@pytest.mark.processes
def test_a_short_run_on_a_real_bus(cli, tmp_path, short_release, monkeypatch):
    monkeypatch.setattr("stillwake.commands.latency._STILLWAKE", STILLWAKE)
    # A microsecond for a plan: broken on any machine. The other limit is kept.
    budget = tmp_path / "budget.toml"
    budget.write_text("misses = 100000\n[plan]\np50_ms = 0.001\n")
    result = tmp_path / "latency.json"
    what = ("--bundle", short_release, "--periods", 100, "--budget", budget, "--json", result)
    found = cli("latency", tmp_path / "report", *what)
    assert found.code == 3, found.err
    assert "over budget: plan.p50_ms" in found.out
    figures = json.loads(result.read_text())["figures"]
    onnx = figures["onnx"]
    assert figures["periods"] == onnx["periods"] >= 100
    assert onnx["stages"]["plan"]["p50_ms"] > 0.001
    assert 0.0 < onnx["baseline"]["p50_ms"] < onnx["stages"]["all"]["p50_ms"]
    assert onnx["baseline"]["periods"] >= 100
    kept = {path.name for path in (tmp_path / "report").iterdir()}
    assert kept == {"report.md", "histogram.png", "onnx", "settings.toml"}
