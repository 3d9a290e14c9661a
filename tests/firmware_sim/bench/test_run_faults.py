"""Faults of a run as text, and what of them cannot be."""

import pytest

from can_bridge.bus.faults.loss import Drop
from contract.config.vehicle import BusConfig
from contract.errors import ConfigError
from firmware_sim.bench.run_faults import NodeFaults, check_faults, parse_node_fault


def test_a_fault_names_its_node_and_what_follows():
    text = "vehicle:drop:probability=0.1,frame_ids=0x120@5..10"
    found = parse_node_fault(text)
    assert (found.text, found.node) == (text, "vehicle")
    assert found.fault == Drop(probability=0.1, frame_ids=(0x120,), start_s=5.0, end_s=10.0)


@pytest.mark.parametrize("text", ["", "drop:probability=0.1", "drop", "background:drop:probability=1", "ECU:babble"])
def test_a_fault_without_a_node_is_refused(text):
    with pytest.raises(ConfigError, match="must begin with the node whose port it is in"):
        parse_node_fault(text)


@pytest.mark.parametrize("text", ["ecu:flip_bits:before_crc=true", "vehicle:stuck_at:counter_runs=true"])
def test_frames_cannot_be_made_anew_without_the_key(text):
    faults = [parse_node_fault(text)]
    check_faults(faults, BusConfig(), duration_s=1.0)
    with pytest.raises(ConfigError, match="makes frames anew"):
        check_faults(faults, BusConfig(key="bus.key"), duration_s=1.0)


@pytest.mark.parametrize("text", ["ecu:flip_bits", "vehicle:stuck_at"])
def test_faults_behind_the_protection_need_no_key(text):
    check_faults([parse_node_fault(text)], BusConfig(key="bus.key"), duration_s=1.0)


def test_a_fault_must_begin_before_the_run_ends():
    faults = [parse_node_fault("ecu:babble@0.5..")]
    check_faults(faults, BusConfig(), duration_s=0.6)
    with pytest.raises(ConfigError, match=r"begins when the run has ended, after 0\.5 s"):
        check_faults(faults, BusConfig(), duration_s=0.5)


def test_a_node_without_faults_keeps_its_port():
    port = object()
    faults = NodeFaults([parse_node_fault("ecu:disconnect")], lambda: 0, 0)
    assert faults.around("vehicle", port) is port
    assert faults.around("ecu", port) is not port
    assert [(one.text, one.acted) for one in faults.injected()] == [("ecu:disconnect", 0)]
