"""`python -m benchmarks`: every measurement is reached by its name and takes `--json`; its file has the one shape."""

import inspect
import json
from datetime import date
from importlib import import_module
from pathlib import Path

import pytest

import benchmarks.__main__ as door
from benchmarks.common.commands import ROOT
from contract.results import machine, write_result

RESULTS = sorted((ROOT / "results").glob("*.json"))


@pytest.mark.parametrize("name", door.MEASUREMENTS)
def test_a_measurement_writes_its_figures_where_it_is_told(name):
    found = inspect.signature(import_module(f"benchmarks.{door.MEASUREMENTS[name].module}").main)
    assert "json_file" in found.parameters
    assert (ROOT / "results" / f"{name.replace('-', '_')}.json").is_file()


def test_the_list_names_all(capsys):
    door.main([])
    words = capsys.readouterr().out.split()
    assert set(words) >= {*door.MEASUREMENTS, *door.PAGES}


def test_an_unknown_name_is_refused_with_the_known_ones():
    with pytest.raises(SystemExit, match="no measurement 'latency': one of wake, wake-speed"):
        door.main(["latency"])


def test_what_a_user_causes_is_one_line(tmp_path):
    with pytest.raises(SystemExit, match=r"^error: .*model.json: No such file"):
        door.main(["controller-loop", "--model", str(tmp_path)])


@pytest.mark.parametrize("path", RESULTS, ids=[path.stem for path in RESULTS])
def test_a_result_has_date_figures_and_facts(path: Path):
    content = json.loads(path.read_text(encoding="utf-8"))
    assert list(content) == ["date", "figures", "facts"]
    assert date.fromisoformat(content["date"]) <= date.today()
    assert content["figures"]
    versions = content["facts"]["versions"]
    assert versions and all(isinstance(version, str) for version in versions.values())


def test_a_result_names_the_machine(tmp_path):
    write_result(tmp_path / "one.json", figures={"Cd": 1.0}, facts={"seed": 3}, on=date(2026, 1, 2))
    assert json.loads((tmp_path / "one.json").read_text()) == {
        "date": "2026-01-02",
        "figures": {"Cd": 1.0},
        "facts": {"seed": 3, "machine": machine()},
    }
