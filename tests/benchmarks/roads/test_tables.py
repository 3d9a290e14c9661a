"""What the table says of a row beside its numbers."""

import json
from typing import Any

from benchmarks.roads.row import Outcome, Row
from benchmarks.roads.tables import tables


def outcome(**changed: Any) -> Outcome:
    given: dict[str, Any] = dict(
        Cd_uncontrolled=1.0,
        Cd_net_uncontrolled=1.1,
        Cd=0.8,
        Cd_net=0.85,
        abs_Cl=0.9,
        mean_Cl=0.0,
        rms_action=0.0,
        jet_power=0.0,
    )
    return Outcome(**{**given, **changed})


def row(road: str, mesh: tuple[int, int] = (443, 164), **changed: Any) -> dict[str, object]:
    given: dict[str, Any] = dict(
        road=road, title=road, kind="baseline", outcomes=(outcome(),), sensors=4, loop="CAN", mesh=mesh, note="so"
    )
    return Row(**{**given, **changed}).as_tree()


def lines(tmp_path, *rows: dict[str, object]) -> list[str]:
    (tmp_path / "roads.json").write_text(json.dumps({"figures": rows}), encoding="utf-8")
    return tables(tmp_path)["roads"].splitlines()[2:]


def test_another_mesh_a_fault_and_seeds_stand_in_the_note(tmp_path):
    found = lines(
        tmp_path,
        row("no-control"),
        row("coarse", mesh=(332, 124)),
        row("lost", outcomes=(outcome(trouble="Control was lost."),)),
        row("drawn", seeds=(0, 3)),
    )
    assert found[0].endswith("| so |") and found[1].endswith("| mesh 332 x 124; so |")
    assert found[2].endswith("| Control was lost.; so |") and found[3].endswith("| seeds 0, 3; so |")


def test_a_side_force_above_the_uncontrolled_one_is_said(tmp_path):
    found = lines(tmp_path, row("no-control"), row("bent", outcomes=(outcome(abs_Cl=1.2),)))
    assert "side force above the uncontrolled one" in found[1]
    assert "side force" not in found[0]


def test_a_span_is_shown_for_several_phases_alone(tmp_path):
    found = lines(tmp_path, row("no-control"), row("two", outcomes=(outcome(Cd=0.7), outcome(Cd=0.8))))
    assert "20.0 .. 30.0" in found[1] and ".." not in found[0]


def test_the_environments_table_has_its_own_mesh_alone_and_no_oracle(tmp_path):
    rows = (row("kept"), row("coarse", mesh=(332, 124)), row("knows", kind="oracle"))
    (tmp_path / "roads.json").write_text(json.dumps({"figures": rows}), encoding="utf-8")
    (found,) = tables(tmp_path)["environment"].splitlines()[2:]
    assert found.startswith("| kept | -0.800 | 0.850 |")
