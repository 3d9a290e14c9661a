"""`stillwake can load`: the table, the figures, and a status that says whether every message is in time."""

import hashlib
import json
import sys
from io import StringIO

from rich.console import Console

DBC = """VERSION ""
NS_ :
BS_:
BU_: Other
BO_ 16 Urgent: 8 Other
BO_ 17 Seldom: 8 Other
BO_ 18 Silent: 8 Other
BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;
BA_DEF_DEF_ "GenMsgCycleTime" 0;
BA_ "GenMsgCycleTime" BO_ 16 10;
BA_ "GenMsgCycleTime" BO_ 17 1000;
"""


def test_our_messages_are_in_time_alone_and_one_that_can_be_late_fails_the_call(cli, printed, tmp_path):
    late = cli("can", "load", "--set", "ecu.compute_time_ms=19.5", "--json", tmp_path / "load.json")
    assert (late.code, "1 of 4 can be late: JetCommand" in late.out) == (3, True)
    assert json.loads((tmp_path / "load.json").read_text())["figures"]["late"] == ["JetCommand"]
    out = printed("can", "load")
    assert all(name in out for name in ("Pressure", "VehicleSpeed", "JetCommand", "EcuStatus"))
    assert "load: 2.7 % with random contents, 3.1 % at worst" in out
    printed("can", "load", "--set", "bus.frames=classic", "--json", tmp_path / "load.json")
    written = json.loads((tmp_path / "load.json").read_text())
    # 135 bits at 500 kbit/s; twice that with the blocking frame.
    pressure = written["figures"]["messages"][0]
    assert (pressure["name"], pressure["frame_worst_ms"], pressure["response_ms"]) == ("PressureClassic", 0.27, 0.54)
    assert written["figures"]["late"] == []
    assert (written["facts"]["frames"], written["facts"]["control_period_ms"]) == ("classic", 20.0)


def test_a_dbc_is_the_background(printed, tmp_path):
    dbc = tmp_path / "vehicle.dbc"
    dbc.write_text(DBC)
    out = printed("can", "load", "--set", f"bus.background.dbc={dbc}", "--json", tmp_path / "load.json")
    assert "left out: Silent (no cycle time)" in out
    written = json.loads((tmp_path / "load.json").read_text())
    figures, facts = written["figures"], written["facts"]
    assert facts["background_sha256"] == hashlib.sha256(dbc.read_bytes()).hexdigest()
    assert set(facts["versions"]) == {"stillwake", "cantools"}
    assert [one["name"] for one in figures["messages"] if not one["ours"]] == ["Urgent", "Seldom"]
    assert figures["left_out"] == ["Silent (no cycle time)"]


def test_a_terminal_of_80_columns_shows_whole_names(cli, monkeypatch):
    written = StringIO()
    # The package has the function under the module's name.
    monkeypatch.setattr(sys.modules["stillwake.commands.can.load"], "console", Console(width=80, file=written))
    assert cli("can", "load", "--set", "bus.frames=classic", "--set", "bus.background.load=0.5").code == 0
    lines = written.getvalue().splitlines()
    # A name that was folded would leave a line of its own, without an identifier.
    rows = [line for line in lines if " yes" in line]
    assert len(lines) == len(rows) + 4 > 34
