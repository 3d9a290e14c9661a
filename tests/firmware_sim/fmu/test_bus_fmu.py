"""The ECU's FMU with a bus terminal, by importers of others: the ECU in C to the bit, and a CAN controller's errors."""

import csv
import json
import struct
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from fmpy import simulate_fmu
from fmpy.validation import validate_fmu

from can_bridge.bus.interface import HEALTHY, BusHealth, BusState
from can_bridge.bus.simulated.attempt import AttemptVerdict, counted
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import message_set
from contract.arrays import Array
from contract.config.vehicle import BusConfig
from ecu.in_c.c_ecu import CEcu
from examples.network_of_fmus import TerminalNode, operation, operations, run
from examples.own_plant import OscillatorPlant
from firmware_sim.bench.ecus import C, loop_ecu
from firmware_sim.bench.simulation import Simulation, Spans
from firmware_sim.bench.vehicle_node import VehicleNode
from tests.ecu.in_c.exported import CONFIG
from tests.firmware_sim.fmu.imported import Imported, refused

pytestmark = pytest.mark.compiler
MS = 1_000_000
STEP_NS, ANSWER_NS, PERIOD_NS = 4 * MS, 12 * MS, CONFIG.period_ns
"""Of the ECU's first step and of its frames, by the settings' defaults."""
FORMAT_ERROR, CONFIRM, LOST, ERROR, CONFIGURATION, STATUS, WAKEUP = 0x01, 0x20, 0x30, 0x31, 0x40, 0x41, 0x42
ACK_ERROR, STATES = 5, (BusState.ERROR_ACTIVE, BusState.ERROR_PASSIVE, BusState.BUS_OFF)
COMMAND_ID = message_set(CONFIG.bus).command.spec.frame_id
CONFIGURED = [(CONFIGURATION, struct.pack("<BI", *rate)) for rate in ((1, 500_000), (2, 2_000_000))]
CONFIGURED += [(CONFIGURATION, b"\4\1")]


def op(code: int, content: bytes = b"") -> bytes:
    return struct.pack("<II", code, 8 + len(content)) + content


class Oscillator:
    """A wake whose jets get one action a control period."""

    def __init__(self) -> None:
        self._plant = OscillatorPlant(CONFIG.flow)

    def pressures(self) -> Array:
        return self._plant.sample().Cp

    def advance(self, action: float) -> None:
        self._plant.advance_to(CONFIG.flow.substeps, action)


def test_on_the_simulated_bus_frames_are_those_of_a_run_with_the_ecu_in_c(release, fmu_of):
    """In classic frames; in those of CAN FD the container of others plays two of them below."""
    config = replace(CONFIG, bus=BusConfig(frames="classic"))
    path, sources = fmu_of(config, bus=True)
    lead_in, periods, t = 10, 70, config.flow.control_period
    own, joined = list[Frame](), list[Frame]()
    spans = Spans(lead_in=lead_in * t, controlled=(periods - lead_in) * t, settle=t, averages=False)
    own_loop = Simulation(release.bundle, config, spans=spans, ecu=loop_ecu(C, sources))
    log = own_loop.run(OscillatorPlant(config.flow), capture=own.append)
    node, vehicle = TerminalNode(path), VehicleNode(release.bundle.manifest.sensors, config)
    run(node, Oscillator(), vehicle, config, periods=periods, asks=lambda k: k >= lead_in, capture=joined.append)
    assert np.abs(log.series["action"]).max() > 0.01
    assert [(one.frame_id, one.data) for one in joined] == [(one.frame_id, one.data) for one in own]
    assert len(own) == 4 * periods


def linked(sources: dict[str, bytes], periods: int, *, hears: tuple[bool, bool]) -> list[list[bytes]]:
    """What two of the ECU in C send that are linked by hand; each says whether it hears the other one."""
    ecus, inboxes, sent = [CEcu(sources) for _ in hears], [list[Frame](), list[Frame]()], [list[bytes](), list[bytes]()]
    for k in range(periods):
        answers = [ecu.step(STEP_NS + k * PERIOD_NS, inbox) for ecu, inbox in zip(ecus, inboxes, strict=True)]
        for i, heard in enumerate(hears):
            sent[i].append(b"".join(map(operation, answers[i])))
            arrived_ns = ANSWER_NS + k * PERIOD_NS
            inboxes[i] = [replace(one, timestamp_ns=arrived_ns) for one in answers[1 - i] if heard]
    return sent


def test_the_fmu_container_of_others_connects_their_terminals_and_plays_them(fmu_of, tmp_path, monkeypatch):
    """Version 2.0 of the container hands data only to the FMU that stands first, and none at a countdown."""
    assembly = pytest.importorskip("fmu_manipulation_toolbox.assembly", reason="fmu-manipulation-toolbox is absent")
    path, sources = fmu_of(bus=True, triggered=True)
    monkeypatch.chdir(tmp_path)
    for name in "ab":
        (tmp_path / f"{name}.fmu").write_bytes(path.read_bytes())
    link = ["a.fmu", "CanChannel", "b.fmu", "CanChannel"]
    made = {"name": "two.fmu", "fmu": ["a.fmu", "b.fmu"], "link": [link], "step_size": STEP_NS / 1e9}
    (tmp_path / "two.json").write_text(json.dumps(made), encoding="utf-8")
    assembly.Assembly("two.json", fmu_directory=tmp_path).make_fmu(fmi_version=3, datalog=True)
    simulate_fmu("two.fmu", stop_time=0.6, step_size=STEP_NS / 1e9, relative_tolerance=1e-9)
    sent: dict[str, list[bytes]] = {"a": [], "b": []}
    with next(tmp_path.glob("*datalog.csv")).open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            for name, own in sent.items():
                content = bytes.fromhex(row[f"{name}.CanChannel.Tx_Data"])
                if row[f"{name}.CanChannel.Tx_Clock"] == "1" and [content] != own[-1:]:  # it logs some lines twice
                    own.append(content)
    assert [own[-30:] for own in sent.values()] == linked(sources, 30, hears=(True, False))


def test_a_wrong_operation_is_answered_and_what_is_beside_it_taken(fmu_of):
    path, sources = fmu_of(bus=True)
    assert validate_fmu(str(path)) == []
    node, ecu = TerminalNode(path), CEcu(sources)
    assert [*operations(node.event(0))] == CONFIGURED
    frame = Frame(frame_id=COMMAND_ID, data=bytes(8))
    transmit, rng = operation(frame)[8:], np.random.default_rng(3)
    wrong = [op(0x99), op(0x11), op(0x11, transmit[:-1]), op(0x11, transmit + b"\0"), op(0x10, transmit), op(0x12)]
    wrong += [op(0x11, b"\0\x08\0\0" + transmit[4:]), op(0x11, transmit[:4] + b"\2" + transmit[5:])]
    wrong += [op(0x11, transmit[:7] + struct.pack("<H", 9) + bytes(9)), op(CONFIRM, b"\0"), op(ERROR, bytes(7))]
    wrong += [b"\1", struct.pack("<II", 0x11, 7), struct.pack("<II", 0x11, 99), struct.pack("<II", 0x11, 2**32 - 1)]
    wrong += [rng.bytes(int(size)) for size in rng.integers(1, 400, size=60)] + [op(0x99, bytes(8000))]
    now_ns = 1
    for one in wrong:
        assert node.event(now_ns, operation(frame) + one) == b""
        assert node.due_ns == now_ns
        (code, answer), *rest = operations(node.event(now_ns))
        assert code == FORMAT_ERROR and not rest
        assert answer == struct.pack("<H", len(one)) + one
        now_ns += 1
    for ignored in (op(FORMAT_ERROR), op(STATUS, b"\1"), op(CONFIGURATION, b"\4\2"), op(WAKEUP), op(LOST, bytes(4))):
        node.event(now_ns, ignored)
        assert node.due_ns == ANSWER_NS
    answers = ecu.step(STEP_NS, [replace(frame, timestamp_ns=k + 1) for k in range(len(wrong))])
    assert node.event(ANSWER_NS) == b"".join(map(operation, answers))


def test_its_controller_counts_errors_and_goes_off_the_bus_as_iso_11898_has_it(fmu_of):
    path, _ = fmu_of(bus=True)
    node, deaf = TerminalNode(path, bus_notifications=True), TerminalNode(path)
    health, rng, now_ns, seen = HEALTHY, np.random.default_rng(1), 1, set[BusState]()
    kinds = (
        (0.30, op(ERROR, struct.pack("<IBBB", 0x7FF, 1, 2, 1)), AttemptVerdict.TRANSMIT_ERROR),
        (0.10, op(ERROR, struct.pack("<IBBB", 0x7FF, ACK_ERROR, 2, 1)), AttemptVerdict.UNACKNOWLEDGED),
        (0.10, op(ERROR, struct.pack("<IBBB", 1, 4, 1, 0)), AttemptVerdict.SIGNALLED_FIRST),
        (0.10, op(ERROR, struct.pack("<IBBB", 1, 4, 2, 0)), AttemptVerdict.RECEIVE_ERROR),
        (0.20, op(CONFIRM, struct.pack("<I", 1)), AttemptVerdict.SENT),
        (0.20, operation(Frame(frame_id=0x7FF, data=b"")), AttemptVerdict.HEARD),
    )
    node.event(0), deaf.event(0)
    for _ in range(1500):
        before = health
        now_ns += 100
        _, content, verdict = kinds[rng.choice(len(kinds), p=[share for share, _, _ in kinds])]
        health = counted(health, verdict)
        for one in (node, deaf):
            assert all(code not in (STATUS, FORMAT_ERROR) for code, _ in operations(one.event(now_ns, content)))
        told = [*operations(node.event(now_ns))] if node.due_ns <= now_ns else []
        changed = [(STATUS, bytes([STATES.index(health.state) + 1]))] if health.state is not before.state else []
        assert [one for one in told if one[0] == STATUS] == changed
        assert deaf.due_ns > now_ns or not [*operations(deaf.event(now_ns))]
        seen.add(health.state)
        if health.bus_off > before.bus_off:
            recovered_ns = now_ns + 128 * 11 * 10**9 // CONFIG.bus.nominal_bitrate
            while now_ns < recovered_ns:
                now_ns = min(max(node.due_ns, now_ns + 1), recovered_ns)
                assert not [*operations(node.event(now_ns))]
            assert (STATUS, b"\1") in [*operations(node.event(now_ns))]
            health = BusHealth(bus_off=health.bus_off)
    assert seen == set(STATES) and health.bus_off > 1


def test_a_frame_that_is_lost_is_sent_again_unless_the_next_waits(fmu_of):
    node = TerminalNode(fmu_of(bus=True)[0], bus_notifications=True)
    node.event(0)
    (_, command), (_, status) = operations(node.event(ANSWER_NS))
    lost = op(LOST, struct.pack("<I", COMMAND_ID))
    failed = op(ERROR, status[:4] + bytes([1, 1, 1]))
    for content, expected in ((lost, [(0x11, command)]), (failed, [(0x11, status)])):
        assert node.event(ANSWER_NS + MS, content) == b""
        assert [*operations(node.event(ANSWER_NS + MS))] == expected
    assert node.event(STEP_NS + PERIOD_NS, lost) == b""
    assert node.due_ns == ANSWER_NS + PERIOD_NS
    assert {code for code, _ in operations(node.event(node.due_ns))} == {0x11}


def test_states_resets_and_instances_are_apart_and_fmpys_defaults_are_served(fmu_of, capsys):
    path, _ = fmu_of(bus=True)
    nodes = [TerminalNode(path), TerminalNode(path)]
    whole = [nodes[0].event(at) for at in (0, ANSWER_NS, ANSWER_NS + PERIOD_NS)]
    assert nodes[1].event(0) == whole[0] != b""
    nodes[0].fmu.reset()
    nodes[0].begin()
    assert [nodes[0].event(at) for at in (0, ANSWER_NS)] == whole[:2]
    state = nodes[0].fmu.serializeFMUState(nodes[0].fmu.getFMUState())
    assert nodes[0].event(ANSWER_NS + PERIOD_NS) == whole[2]
    other = nodes[1].fmu
    other.setFMUState(other.deserializeFMUState(state))
    other.doStep(currentCommunicationPoint=ANSWER_NS / 1e9, communicationStepSize=PERIOD_NS / 1e9)
    other.enterEventMode()
    other.setClock(nodes[1].of("Tx_Clock"), [True])
    assert bytes(other.getBinary(nodes[1].of("Tx_Data"))[0]) == whole[2]
    given = {"step_offset": 0.001}
    for events in (False, True):
        simulated = simulate_fmu(str(path), stop_time=0.1, use_event_mode=events, start_values=given, output=["mode"])
        assert simulated["time"][-1] == 0.1


def test_at_a_start_time_since_1970_it_steps_at_the_same_times(fmu_of):
    """As doubles such times in s are up to 120 ns off."""
    path, counts = fmu_of(bus=True)[0], list[list[int]]()
    for start in (0.0, 1.7e9):
        imported = Imported(path, start=start)
        counts.append([])
        for k in range(100):
            imported.time = start + k / 1000
            imported.step(0.001)
            counts[-1].append(imported["missed"])
    assert counts[1] == counts[0] and counts[0][-1] == 5


def test_a_wrong_call_is_refused_with_a_line_and_changes_nothing(fmu_of, capsys):
    node = TerminalNode(fmu_of(bus=True)[0])
    fmu, of = node.fmu, node.of
    offset = [node.references["step_offset"]]
    for words, call in (
        ("fmi3SetClock: only in event mode", partial(fmu.setClock, of("Rx_Clock"), [True])),
        ("fmi3SetBinary: only", partial(fmu.setBinary, of("Rx_Data"), [b"1"])),
        ("fmi3UpdateDiscreteStates: only", fmu.updateDiscreteStates),
        ("fmi3EnterStepMode: only", fmu.enterStepMode),
        ("a parameter is set before the first step", partial(fmu.setFloat64, offset, [0.001])),
    ):
        refused(capsys, words, call)
    fmu.enterEventMode()
    for words, call in (
        ("Rx_Data has at most 8192 bytes", partial(fmu.setBinary, of("Rx_Data"), [bytes(8193)])),
        ("only Rx_Data is an input", partial(fmu.setBinary, of("Tx_Data"), [b"1"])),
        ("of no such variable", partial(fmu.getBinary, offset)),
        ("of no clock", partial(fmu.setClock, of("Rx_Data"), [True])),
        ("only Tx_Clock can be an output", partial(fmu.getClock, of("Rx_Clock"))),
        ("fmi3DoStep: only", partial(fmu.doStep, 0.0, 0.1)),
        ("fmi3EnterEventMode: only", fmu.enterEventMode),
    ):
        refused(capsys, words, call)
    fmu.reset()
    for name, value in (("step_offset", 0.02), ("compute_time", 0.02), ("step_offset", -1e-9)):
        fmu.reset()
        fmu.setFloat64([node.references[name]], [value])
        fmu.enterInitializationMode(startTime=0.0)
        refused(capsys, f"{name}: must be in 0 s..a control period", fmu.exitInitializationMode)
