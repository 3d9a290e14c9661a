"""ASAM MDF: what other programs write is read, and what is written is read by other programs, value by value."""

from datetime import datetime, timedelta, timezone

import can
import numpy as np
import pytest

from can_bridge.logs.entries import ChannelGroup, NamedChannel
from can_bridge.logs.log_reader import CanLog
from can_bridge.logs.mdf_file import write_mdf
from contract.errors import BusError
from tests.can_bridge.logs.log_texts import frames, identity
from tests.refused import refused

asammdf = pytest.importorskip("asammdf")
WORDS = {0: "OFF", 2: "CONTROL", 5: "FAULT"}


def messages() -> list[can.Message]:
    """Of every kind, on three channels, one of which has a number."""
    made = [*frames(64), can.Message(timestamp=0.6, arbitration_id=0x7DF, is_remote_frame=True, dlc=8)]
    made += [can.Message(timestamp=0.61, arbitration_id=bit, is_error_frame=True) for bit in (0x8, 0x20)]
    for k, one in enumerate(made):
        one.channel, one.is_rx = ("can0", "2", "can1")[k % 3], k % 4 != 0
    return made


def groups() -> list[ChannelGroup]:
    times = 0.25 + np.cumsum(np.linspace(0.01, 0.02, 40))
    channels = (
        NamedChannel("Pressure0", "Pa", 1e3 * np.sin(times)),
        NamedChannel("Cd", "", np.where(times > 0.5, times, np.nan)),
        NamedChannel("Mode", "", np.resize([0.0, 2.0, 5.0], 40), WORDS),
    )
    return [ChannelGroup(name="Run", times_s=times, channels=channels, comment="W = 2.5 m")]


def test_frames_are_those_that_python_can_reads(tmp_path):
    sent = messages()
    for start in (0.0, 1_700_000_000.0):
        for one in sent:
            one.timestamp += start
        write_mdf(tmp_path / "a.mf4", sent, groups() if not start else [])
        with can.MF4Reader(tmp_path / "a.mf4") as reader:
            theirs = list(reader)
        log = CanLog(tmp_path / "a.mf4")
        ours = list(log)
        assert log.channels == {"1": 23, "2": 22, "3": 22}
        assert log.events == ({"record of Run": 40} if not start else {})
        numbers = {"can0": 1, "2": 2, "can1": 3}
        for one, other, third in zip(sent, theirs, ours, strict=True):
            for read in (other, third):
                assert (one.is_error_frame, one.is_remote_frame) == (read.is_error_frame, read.is_remote_frame)
                assert read.timestamp == pytest.approx(one.timestamp, rel=0, abs=3e-7 if start else 1e-12)
                assert int(str(read.channel)) == numbers[str(one.channel)]
                assert (identity(read), read.dlc) == (identity(one), 0 if one.is_error_frame else one.dlc)
            assert third.arbitration_id == one.arbitration_id


def test_channels_are_those_that_mdfreader_reads(tmp_path):
    mdfreader = pytest.importorskip("mdfreader")
    write_mdf(tmp_path / "a.mf4", messages(), groups())
    read = mdfreader.Mdf(str(tmp_path / "a.mf4"))
    (group,) = groups()
    for one in group.channels:
        name = f"Run.{one.name}"
        values = np.array([WORDS[int(value)] for value in one.values]) if one.words else one.values
        np.testing.assert_array_equal(read.get_channel_data(name), values)
        assert read.get_channel_unit(name) == one.unit
        times_s = read.get_channel_data(read.get_channel_master(name))
        np.testing.assert_allclose(times_s, group.times_s, rtol=0, atol=1e-12)
    data = [one for one in messages() if not one.is_error_frame and not one.is_remote_frame]
    assert read.get_channel_data("CAN_DataFrame.ID").tolist() == [one.arbitration_id for one in data]


def test_other_groups_missing_fields_and_constants_in_conversions_are_read(tmp_path):
    """A classic bus beside an analog signal, with identifiers of 29 bits marked by their uppermost; and as CANedge
    (firmware 1.7) does: no bits, and the value in the conversion; a direction is a text."""
    times = np.array([0.25, 0.5, 0.75])
    signals = [
        asammdf.Signal(np.array([5, 0x80000006, 7], "<u4"), times, name="CAN_DataFrame.ID"),
        asammdf.Signal(np.array([2, 12, 0], "u1"), times, name="CAN_DataFrame.DLC"),
        asammdf.Signal(np.arange(24, dtype="u1").reshape(3, 8), times, name="CAN_DataFrame.DataBytes"),
        asammdf.Signal(
            np.array([1, 0, 1], "u1"), times, name="CAN_DataFrame.Dir",
            conversion={"val_0": 0, "text_0": b"Rx", "val_1": 1, "text_1": b"Tx"},
        ),
    ]  # fmt: skip
    virtual = {"flags": asammdf.Signal.Flags.virtual, "samples": np.arange(3, dtype="u8"), "timestamps": times}
    constants = [
        asammdf.Signal(**virtual, name=f"CAN_DataFrame.{name}", virtual_conversion={"a": 0.0, "b": value})
        for name, value in (("BusChannel", 9.0), ("IDE", 1.0))
    ]
    for more, channel, extended in (([], "", [False, True, False]), (constants, "9", [True] * 3)):
        with asammdf.MDF(version="4.11") as measurement:
            measurement.start_time = datetime(2026, 11, 27, 12, tzinfo=timezone(timedelta(hours=2)))
            measurement.append(asammdf.Signal(np.arange(5.0), np.arange(5.0), name="Wind"))
            measurement.append([*signals, *more], common_timebase=True)
            measurement.save(tmp_path / "a.mf4", overwrite=True)
        log = CanLog(tmp_path / "a.mf4")
        read = list(log)
        assert [one.timestamp for one in read] == [1795773600.25, 1795773600.5, 1795773600.75]
        wanted = [(channel, frame_id, is_rx, False) for frame_id, is_rx in ((5, False), (6, True), (7, False))]
        assert [(one.channel, one.arbitration_id, one.is_rx, one.is_fd) for one in read] == wanted
        assert [one.is_extended_id for one in read] == extended
        assert [bytes(one.data) for one in read] == [b"\0\1", bytes(range(8, 16)), b""]
        assert (log.events, log.is_local) == ({"record of Wind": 5}, False)


def test_what_is_no_log_of_frames_is_one_line(tmp_path, capfd):
    write_mdf(tmp_path / "whole.mf4", messages(), groups())
    whole = (tmp_path / "whole.mf4").read_bytes()
    for length in [*range(0, len(whole), len(whole) // 15), len(whole) - 1]:
        (tmp_path / "a.mf4").write_bytes(whole[:length])
        with refused(BusError, r"a\.mf4: cannot be read as a CAN log \(cut off, damaged, or not ASAM MDF: "):
            list(CanLog(tmp_path / "a.mf4"))
    with asammdf.MDF(version="4.10") as measurement:
        measurement.append(asammdf.Signal(np.arange(5.0), np.arange(5.0), name="Wind"))
        measurement.save(tmp_path / "b.mf4")
    with refused(BusError, r"b\.mf4: has no CAN frames .*; it has record of Wind 5"):
        list(CanLog(tmp_path / "b.mf4"))
    times, samples = np.arange(2.0), {"ID": np.array([5, 6], "<u4"), "DataLength": np.array([8, 9], "u1")}
    samples["DataBytes"] = np.zeros((2, 64), "u1")
    with asammdf.MDF(version="4.10") as measurement:
        measurement.append([asammdf.Signal(one, times, name=f"CAN_DataFrame.{name}") for name, one in samples.items()])
        measurement.save(tmp_path / "c.mf4")
    with refused(BusError, r"c\.mf4: .* \(no classic CAN frame has 9 bytes"):
        list(CanLog(tmp_path / "c.mf4"))
    assert capfd.readouterr() == ("", "")
