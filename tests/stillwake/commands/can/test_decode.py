"""`stillwake can decode`: lines, summary, CSV and JSON of a log, and what is refused."""

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import can
import pytest

from can_bridge.logs.frame_log import recording_messages
from tests.stillwake.commands.can.bus_traffic import write
from tests.stillwake.commands.can.virtual_bus import DBC, VIRTUAL, flat, taken


@pytest.fixture
def signed_log(cli: Callable[..., Any], peer: can.BusABC, tmp_path: Path) -> Path:
    """Three genuine frames, and the first again; beside it `bus.key` and another one, `other.key`."""
    for name in ("bus.key", "other.key"):
        assert cli("can", "keygen", tmp_path / name).code == 0
    setting = ("--set", f"bus.key={tmp_path / 'bus.key'}")
    assert cli("can", "send", "PressureSecured", "--count", 3, "--trip", 1, *setting, *VIRTUAL).code == 0
    frames = taken(peer)
    with recording_messages(tmp_path / "signed.log") as append:
        for i, one in enumerate([*frames, frames[0]]):
            one.timestamp = 100.0 + 0.02 * i
            append(one)
    return tmp_path / "signed.log"


@pytest.mark.parametrize(
    ("key", "counts", "is_checked"),
    [
        ("bus.key", {"OK": 3, "not fresh": 1}, True),
        ("other.key", {"not authentic": 4}, True),
        (None, {"OK": 3, "wrong sequence": 1}, False),
    ],
)
def test_decode_and_monitor_check_the_mac_with_a_key_and_say_so_without_one(
    cli: Callable[..., Any], signed_log: Path, key: str | None, counts: dict[str, int], is_checked: bool
) -> None:
    setting = () if key is None else ("--set", f"bus.key={signed_log.parent / key}")
    made = signed_log.with_suffix(".json")
    got = cli("can", "decode", signed_log, "--json", made, "--csv", signed_log.with_suffix(".csv"), *setting)
    assert got.code == 0, got.err
    (message,) = json.loads(made.read_text())["figures"]["messages"]
    assert (message["checks"], message["mac_checked"]) == (counts, is_checked)
    assert ("MAC not checked: name the key" in got.out) is not is_checked
    ends = [line.rpartition("[")[2] for line in got.out.splitlines() if "PressureSecured:" in line]
    with signed_log.with_suffix(".csv").open(newline="") as file:
        macs = [row["mac"] for row in csv.DictReader(file) if row["signal"] == "Pressure0"]
    if key == "bus.key":
        assert ends == ["E2E OK, MAC OK]"] * 3 + ["MAC not fresh]"]
        assert macs == ["OK"] * 3 + ["not fresh"]
    elif key is None:
        assert ends == ["E2E OK, MAC not checked]"] * 3 + ["E2E wrong sequence, MAC not checked]"]
        assert macs == ["not checked"] * 4
    else:
        assert ends == ["MAC not authentic]"] * 4
        assert macs == ["not authentic"] * 4
    seen = cli("can", "monitor", "--log", signed_log, "--once", *setting)
    assert seen.code == 0, seen.err
    assert f" lost, {4 - counts.get('OK', 0)} refused" in seen.out
    assert (", MAC not checked" in seen.out) is not is_checked
    newest = {"bus.key": "not fresh", "other.key": "not authentic", None: "wrong sequence"}[key]
    assert newest in flat(seen.out)


def test_decode_prints_a_line_a_frame_and_a_summary(cli: Callable[..., Any], tmp_path: Path) -> None:
    write(tmp_path / "a.log", 3)
    got = cli("can", "decode", tmp_path / "a.log")
    assert got.code == 0, got.err
    lines = got.out.splitlines()
    assert lines[1].startswith("(1700000000.008000) 130 JetCommand: E2E_CRC=")
    assert lines[1].endswith("Flow=0 m2/s, PressureCounter=0  [E2E OK]")
    assert lines[3] == "(1700000000.012000) 18FEF100 unknown: 00 00 00 00 00 00 00 00"
    assert "130 JetCommand 3 50.00 0.008000 0.048000 0 OK 3" in flat(got.out)
    assert "12 data frames, 0 remote, 0 error frames in 0.052000 s from 1700000000.000000; load of the bus" in got.out
    assert cli("can", "decode", tmp_path / "a.log", "--summary").out.splitlines()[0].strip() == ""


def test_decode_writes_a_row_for_every_signal(cli: Callable[..., Any], tmp_path: Path) -> None:
    write(tmp_path / "a.blf", 2)
    got = cli("can", "decode", tmp_path / "a.blf", "--csv", tmp_path / "a.csv", "--summary")
    assert got.code == 0, got.err
    with (tmp_path / "a.csv").open(newline="") as file:
        found = list(csv.DictReader(file))
    flows = [row for row in found if row["signal"] == "Flow"]
    assert [(row["time_s"], row["id"], row["e2e"], float(row["value"]), row["unit"]) for row in flows] == [
        ("1700000000.008000", "130", "OK", 0.0, "m2/s"),
        ("1700000000.028000", "130", "OK", pytest.approx(0.1), "m2/s"),
    ]
    unknown = [row for row in found if row["id"] == "18FEF100"]
    assert [row["text"] for row in unknown] == ["00" * 8, "01" * 8]
    again = cli("can", "decode", tmp_path / "a.blf", "--csv", tmp_path / "a.csv")
    assert again.code == 1
    assert "--overwrite" in again.err


def test_decode_with_another_dbc(cli: Callable[..., Any], tmp_path: Path) -> None:
    write(tmp_path / "a.log", 1)
    (tmp_path / "o.dbc").write_text(
        'VERSION ""\nNS_ :\nBS_:\nBU_: A\nBO_ 2566844672 Engine: 8 A\n SG_ Load : 0|8@1+ (1,-125) [0|0] "%" A\n'
    )
    got = cli("can", "decode", tmp_path / "a.log", "--dbc", tmp_path / "o.dbc")
    assert "18FEF100 Engine: Load=-125 %" in got.out
    assert "JetCommand: E2E_CRC=" in got.out
    assert cli("can", "decode", tmp_path / "a.log", "--dbc", DBC).code == 0


def test_decode_refuses_in_one_line_and_writes_nothing(
    cli: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write(Path("good.log"), 1)
    for name in ("cut.blf", "cut.asc"):
        write(Path(name), 100)
        Path(name).write_bytes(Path(name).read_bytes()[:-100])
    for name in ("empty.log", "empty.blf"):
        Path(name).touch()
    Path("folder").mkdir()
    before = sorted(path.name for path in tmp_path.iterdir())
    for words, error in [
        (["missing.log"], "missing.log: there is no such file"),
        (["empty.log"], "empty.log: holds no CAN frame"),
        (["empty.blf"], "empty.blf: cannot be read as a CAN log"),
        (["cut.blf"], "cut.blf: "),
        (["cut.asc"], "cut.asc: "),
        (["good.log", "--dbc", "empty.blf"], "empty.blf: no description of a CAN bus"),
        (["good.log", "--dbc", "missing.dbc"], "missing.dbc: No such file"),
        (["good.log", "--csv", "good.log"], "is one of the files to read"),
        (["good.log", "--csv", "folder"], "it is a directory"),
        (["good.log", "--json", "folder"], "it is a directory"),
        (["good.log", "--set", "bus.interface=virtual"], "`can decode` does not use it"),
        (["folder"], "a log must end in"),
    ]:
        got = cli("can", "decode", "--summary", *words, *(() if "--csv" in words else ("--csv", "out.csv")))
        assert got.code == 1, (words, error)
        assert error in got.err, (words, error)
        assert got.err.count("\n") == 1, (words, error)
        assert sorted(path.name for path in tmp_path.iterdir()) == before, (words, error)
