"""`python -m benchmarks`: every measurement is reached by its name and takes `--json`; its file has the one shape."""

import inspect
import json
import signal
from collections.abc import Iterator
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


@pytest.fixture(autouse=True)
def _signals() -> Iterator[None]:
    """The door takes SIGTERM for the whole process."""
    before = signal.getsignal(signal.SIGTERM)
    yield
    signal.signal(signal.SIGTERM, before)


def ended(*arguments: str) -> object:
    with pytest.raises(SystemExit) as stop:
        door.main([*arguments])
    return stop.value.code


def test_the_list_names_all(capsys):
    assert ended() == 0
    words = capsys.readouterr().out.split()
    assert set(words) >= {*door.MEASUREMENTS, *door.PAGES}


def test_an_unknown_name_is_refused_with_the_known_ones(capsys):
    assert ended("nothing-of-ours") == 1
    assert capsys.readouterr().err.startswith("error: no measurement 'nothing-of-ours': one of wake, wake-speed, ")


def test_what_a_user_causes_is_one_line(tmp_path, capsys):
    assert ended("controller-loop", "--model", str(tmp_path)) == 1
    err = capsys.readouterr().err
    assert err.startswith("error: ") and "model.json: No such file" in err and err.count("\n") == 1


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
