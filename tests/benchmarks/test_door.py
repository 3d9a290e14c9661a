"""`python -m benchmarks`: every measurement is reached by its name and takes `--json`; its file has the one shape."""

import inspect
import json
import signal
from collections.abc import Iterator
from datetime import date
from importlib import import_module

import pytest

import benchmarks.__main__ as door
from benchmarks.common.command_line import ROOT
from contract.results import machine, write_result


@pytest.fixture(autouse=True)
def _signals() -> Iterator[None]:
    """Restore the handler of SIGTERM, which the door sets for the whole process."""
    before = signal.getsignal(signal.SIGTERM)
    yield
    signal.signal(signal.SIGTERM, before)


def status_of(*arguments: str) -> object:
    with pytest.raises(SystemExit) as stop:
        door.main([*arguments])
    return stop.value.code


def test_every_measurement_takes_a_file_for_its_figures_and_has_one():
    for name, measurement in door.MEASUREMENTS.items():
        main = import_module(f"benchmarks.{measurement.module}").main
        assert "json_file" in inspect.signature(main).parameters, name
        assert (ROOT / "results" / f"{name.replace('-', '_')}.json").is_file(), name


def test_the_list_names_all(capsys):
    assert status_of() == 0
    assert set(capsys.readouterr().out.split()) >= {*door.MEASUREMENTS, *door.PAGES}
    assert status_of("nothing-of-ours") == 1
    names = ", ".join(door.MEASUREMENTS | door.PAGES)
    assert capsys.readouterr().err == f"error: no measurement 'nothing-of-ours': one of {names}\n"


def test_an_error_of_the_user_is_one_line(tmp_path, capsys):
    assert status_of("release-loop", "--bundle", str(tmp_path / "none")) == 1
    assert capsys.readouterr().err == f"error: bundle {tmp_path / 'none'}: no such directory\n"


def test_a_result_has_date_figures_facts_and_machine(tmp_path):
    for path in sorted((ROOT / "results").glob("*.json")):
        content = json.loads(path.read_text(encoding="utf-8"))
        assert list(content) == ["date", "figures", "facts"], path
        assert date.fromisoformat(content["date"]) <= date.today(), path
        versions = content["facts"]["versions"]
        assert content["figures"] and versions and all(isinstance(item, str) for item in versions.values()), path
    write_result(tmp_path / "one.json", figures={"Cd": 1.0}, facts={"seed": 3}, on=date(2026, 1, 2))
    wanted = {"date": "2026-01-02", "figures": {"Cd": 1.0}, "facts": {"seed": 3, "machine": machine()}}
    assert json.loads((tmp_path / "one.json").read_text()) == wanted
