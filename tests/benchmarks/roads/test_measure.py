"""The command: rows of other roads stay, names and files are checked before the work."""

import json
from importlib.util import find_spec

import pytest

from benchmarks.roads import measure
from benchmarks.roads.listing import ROADS
from contract.errors import StillwakeError


def row(road: str, Cd: float = 1.0) -> dict[str, object]:
    return {"road": road, "Cd": Cd}


def test_a_new_row_takes_the_place_of_its_road_and_others_stay():
    names = list(ROADS)
    before = [row(names[2]), row(names[0]), row("of another version")]
    found = measure.merged(before, [row(names[2], 0.5), row(names[1])])
    assert [one["road"] for one in found] == [*names[:3], "of another version"]
    assert found[2]["Cd"] == 0.5 and found[0]["Cd"] == 1.0


def test_an_unknown_road_is_refused_with_the_known_ones():
    with pytest.raises(StillwakeError, match="no road 'motorway': one of no-control, steady"):
        measure.checked(["no-control", "motorway"])


@pytest.mark.parametrize("content", ["{", "[]", '{"figures": [{"name": "x"}]}', '{"figures": 3}'])
def test_a_file_without_rows_is_refused_and_left_alone(tmp_path, content):
    path = tmp_path / "roads.json"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(StillwakeError, match=r"roads\.json: holds no rows of roads"):
        measure.present(path)
    assert path.read_text(encoding="utf-8") == content


def test_rows_of_a_file_are_read_and_a_missing_one_has_none(tmp_path):
    path = tmp_path / "roads.json"
    assert measure.present(path) == [] == measure.present(None)
    path.write_text(json.dumps({"date": "2026-01-02", "figures": [row("sine")], "facts": {}}), encoding="utf-8")
    assert measure.present(path) == [row("sine")]


@pytest.mark.parametrize("module", sorted(set(ROADS.values())))
def test_every_road_has_its_module(module):
    assert find_spec(f"benchmarks.roads.{module}") is not None
