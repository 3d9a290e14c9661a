"""Measurements of frames: other programs read their signals, value by value."""

import json
import os
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest
from mcap_protobuf.decoder import DecoderFactory

from can_bridge.logs.entries import ChannelGroup, NamedChannel
from can_bridge.logs.log_reader import CanLog
from can_bridge.logs.mcap_file import layout_of
from can_bridge.tools.measurement import groups_of, live_log, write_measurement
from can_bridge.wire.frame import Frame
from contract.errors import BusError, StillwakeError
from stillwake.console.endings import missing
from tests.can_bridge.drives.drive_log import drive, log_of
from tests.can_bridge.logs.log_texts import identity
from tests.can_bridge.logs.test_mdf import messages
from tests.refused import refused

small_mcap = pytest.importorskip("small_mcap")
pytest.importorskip("asammdf")


def read_mcap(path: Path) -> Iterator[tuple[str, str, int, Any]]:
    """(topic, schema, time in ns, message): the container by another library, the content by the schemas in it."""
    with path.open("rb") as file:
        for one in small_mcap.read_message_decoded(file, decoder_factories=[DecoderFactory()]):
            assert one.channel.message_encoding == "protobuf"
            yield one.channel.topic, one.schema.name, one.message.log_time, one.decoded_message


def test_an_mcap_has_frames_and_channels_with_their_words_and_the_layout_draws_them(tmp_path):
    """That the channels are what cantools decodes is tested in `test_signals.py`."""
    for kind in ("fd", "classic", "secured"):
        sent = log_of(drive(kind, 60, 3))
        sent.append(can.Message(timestamp=sent[-1].timestamp, arbitration_id=0x18FEF100, data=b"\1\2"))
        assert not write_measurement(tmp_path / "a.mcap", sent)
        read: dict[str, list[tuple[int, Any]]] = {}
        for topic, schema, time_ns, values in read_mcap(tmp_path / "a.mcap"):
            assert schema == f"stillwake.{'Frame' if topic == '/frames' else topic[1:]}"
            read.setdefault(topic, []).append((time_ns, values))
        frames = [(time_ns, one.id, one.data, one.extended) for time_ns, one in read.pop("/frames")]
        given = [(round(one.timestamp * 1e9), one.arbitration_id, bytes(one.data), one.is_extended_id) for one in sent]
        assert frames == given
        paths = set()
        for group in groups_of(sent)[0]:
            times, rows = zip(*read.pop(f"/{group.name}"), strict=True)
            assert [*times] == np.rint(group.times_s * 1e9).tolist()
            for channel in group.channels:
                paths.add(f"/{group.name}.{channel.identifier}")
                assert [getattr(row, channel.identifier) for row in rows] == channel.values.tolist()
            if group.name.startswith("JetCommand"):
                words = rows[0].DESCRIPTOR.fields_by_name["Mode"].enum_type.values_by_number
                assert words[rows[0].Mode].name == "CONTROL"
        assert not read
        layout = json.loads(layout_of(tmp_path / "a.mcap").read_text())
        drawn = {one["value"] for panel in layout["configById"].values() for one in panel.get("paths", ())}
        ours = {path for path in drawn if path.split(".")[0] in {one.split(".")[0] for one in paths}}
        assert len(ours) == 6
        assert ours <= paths


def test_the_frames_of_an_mcap_are_read_as_they_were_given(tmp_path):
    """Of every kind; a file that is cut, or has no frame, is one line."""
    sent, path = messages(), tmp_path / "a.mcap"
    for k, one in enumerate(sent):
        one.channel, one.error_state_indicator = one.channel if k % 3 else "", one.is_fd and k % 4 == 0
    run = ChannelGroup(name="Run", times_s=np.arange(3.0), channels=(NamedChannel("a", "", np.arange(3.0)),))
    write_measurement(path, sent, more=[run])
    log = CanLog(path)
    for one, read in zip(sent, log, strict=True):
        assert (read.is_error_frame, read.arbitration_id) == (one.is_error_frame, one.arbitration_id)
        assert read.timestamp == pytest.approx(one.timestamp, rel=0, abs=1e-9)
        assert (identity(read), read.channel) == (identity(one), one.channel)
    assert log.channels == {"": 23, "2": 22, "can1": 22} and log.events == {"record of Run": 3}
    whole = path.read_bytes()
    for length in [*range(0, len(whole), len(whole) // 20), len(whole) - 1]:
        path.write_bytes(whole[:length])
        with refused(BusError, r"a\.mcap: cannot be read as a CAN log \("):
            list(CanLog(path))
    write_measurement(path, [can.Message(timestamp=1.0, arbitration_id=1, is_fd=True, data=bytes(9))])
    with refused(BusError, r"a\.mcap: .* \(no CAN FD frame has 9 bytes"):
        list(CanLog(path))
    write_measurement(path, [], more=[run])
    with refused(BusError, r"a\.mcap: has no CAN frames, only 3 other messages"):
        list(CanLog(path))


def test_frames_whose_times_go_back_are_written_in_the_order_of_time(tmp_path):
    sent = log_of(drive("fd", 20, 5))
    write_measurement(tmp_path / "a.mf4", [*sent[::2], *sent[1::2]])
    read = list(CanLog(tmp_path / "a.mf4"))
    assert [bytes(one.data) for one in read] == [bytes(one.data) for one in sent]


def test_damaged_frames_are_counted_by_name_and_a_second_channel_has_its_own_group():
    sent = log_of(drive("fd", 20, 4))
    for one in sent[:4:2]:
        one.data[0] ^= 1
    for one in sent[10:]:
        one.channel = "bus ä7"  # names of groups are ASCII in MCAP
    groups, skipped = groups_of(sent)
    assert skipped == {"Pressure with a wrong CRC, length or value": 2}
    counts = {one.name: len(one.times_s) for one in groups}
    assert set(counts) == {"Pressure", "JetCommand", "Pressure_bus_7", "JetCommand_bus_7"}
    assert sum(counts.values()) == len(sent) - 2


def test_what_cannot_be_written_is_one_line_and_leaves_what_was_there(tmp_path, monkeypatch):
    sent = log_of(drive("fd", 20, 5))
    early = [can.Message(timestamp=-1.0, arbitration_id=1), *sent]
    broken = ChannelGroup(name="Run", times_s=np.arange(3.0), channels=(NamedChannel("a", "", np.arange(2.0)),))
    for name in ("a.mf4", "a.mcap"):
        (tmp_path / name).write_text("before")
        with pytest.raises(Exception, match=r"."):
            write_measurement(tmp_path / name, sent, more=[broken])
        assert (tmp_path / name).read_text() == "before"
        with refused(BusError, "there is no frame to write"):
            write_measurement(tmp_path / name, [])
    with refused(BusError, r"a\.mcap: MCAP has no times before 0, but the first time is -1 s"):
        write_measurement(tmp_path / "a.mcap", early)
    many = [can.Message(timestamp=1.0, arbitration_id=1, channel=f"vcan{k}") for k in range(256)]
    with refused(BusError, "can number 255 channels, but the frames have 256"):
        write_measurement(tmp_path / "a.mf4", many)
    write_measurement(tmp_path / "a.mf4", early)
    assert next(iter(CanLog(tmp_path / "a.mf4"))).timestamp == -1.0
    with refused(BusError, r"a\.txt: a measurement must end in \.mf4 or \.mcap"):
        write_measurement(tmp_path / "a.txt", sent)
    for package in ("asammdf", "mcap_protobuf"):
        monkeypatch.setitem(sys.modules, package, None)
    with refused(BusError, r"b\.mf4: ASAM MDF needs asammdf: pip install '\.\[mdf\]'"):
        write_measurement(tmp_path / "b.mf4", sent)
    with pytest.raises(ModuleNotFoundError) as missed:
        write_measurement(tmp_path / "b.mcap", sent)
    assert "pip install '.[mcap]'" in missing(str(missed.value.name))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.mcap", "a.mf4"]


def test_a_live_log_has_the_frames_of_all_threads_in_the_order_of_time_also_after_an_error(tmp_path):
    began, name = time.time(), "a.mf4"

    def put(keep, frame_id):
        for k in range(200):
            keep(Frame(frame_id=frame_id, data=bytes([k]), is_fd=False), frame_id == 1)

    for fails in (False, True):
        lost = pytest.raises(BusError, match="the bus is lost") if fails else nullcontext()
        with lost, live_log(tmp_path / name) as keep, ThreadPoolExecutor(2) as threads:
            for frame_id in (1, 2):
                threads.submit(put, keep, frame_id)
            time.sleep(0.1)
            if fails:
                raise BusError("the bus is lost")
        assert [path.name for path in tmp_path.iterdir()] == [name]
        read = list(CanLog(tmp_path / name))
        for frame_id in (1, 2):
            mine = [one for one in read if one.arbitration_id == frame_id]
            assert [one.data[0] for one in mine] == list(range(200))
            assert {one.is_rx for one in mine} == {frame_id == 1}
        times = [one.timestamp for one in read]
        assert times == sorted(times)
        assert began - 0.01 < times[0] <= times[-1] < time.time() + 0.01
        (tmp_path / name).unlink()


def test_the_frames_of_a_killed_process_of_the_same_number_remain(tmp_path):
    left = tmp_path / f".a.mcap.{os.getpid()}.log"
    left.write_text("(1.000000) can0 123#11\n")
    with live_log(tmp_path / "a.mcap") as keep:
        keep(Frame(frame_id=1, data=b""), True)
    assert left.read_text() == "(1.000000) can0 123#11\n"
    assert {path.suffix for path in tmp_path.iterdir()} == {".log", ".mcap", ".json"}


def test_a_live_log_that_cannot_be_written_says_so_at_the_end(tmp_path, monkeypatch):
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(can.CanutilsLogWriter, "on_message_received", full)
    full_disk = r"a\.mf4: the log is not complete: No space left on device"
    with refused(StillwakeError, full_disk), live_log(tmp_path / "a.mf4") as keep:
        keep(Frame(frame_id=1, data=b""), True)
    assert not list(tmp_path.iterdir())
