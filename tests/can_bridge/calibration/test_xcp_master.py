"""The slave and pyxcp's master, on a bus that answers at once."""

import logging
import queue
import struct

import can
import pytest

from can_bridge.calibration.segment import ADDRESS
from can_bridge.flashing.access_level import Level
from tests.can_bridge.calibration.conftest import REFERENCE
from tests.can_bridge.uds.addresses import COMMAND_ID, XCP_RESPONSE_ID

config = pytest.importorskip("pyxcp.config")
masters = pytest.importorskip("pyxcp.master")
types = pytest.importorskip("pyxcp.types")
checksum = pytest.importorskip("pyxcp.checksum")
EFFORT = ADDRESS + 20


class SlaveBus(can.BusABC):
    """The slave behind python-can's interface."""

    def __init__(self, slave):
        self._slave = slave
        self._answers: queue.Queue[can.Message] = queue.Queue()
        super().__init__(channel=0)

    def send(self, msg, timeout=None):
        assert msg.arbitration_id == COMMAND_ID
        for answer in self._slave.command(0, bytes(msg.data)):
            self._answers.put(can.Message(arbitration_id=XCP_RESPONSE_ID, data=answer, is_extended_id=False))

    def _recv_internal(self, timeout):
        try:
            return self._answers.get(timeout=timeout), False
        except queue.Empty:
            return None, False


@pytest.fixture
def master(slave, access):
    settings = {
        "Transport": {"CAN": {"can_id_master": COMMAND_ID, "can_id_slave": XCP_RESPONSE_ID, "interface": "virtual"}}
    }
    application = config.create_application_from_config(settings, log_level=logging.ERROR)
    application.general.seed_n_key_function = lambda resource, seed: access.answer(Level.CALIBRATION, seed)
    bus = SlaveBus(slave)
    master = masters.Master("can", config=application, transport_layer_interface=bus)
    with master:
        yield master
    bus.shutdown()
    config.reset_application()


def test_a_master_connects_reads_writes_and_stores(master, slave, segment):
    found = master.connect()
    assert (found.maxCto, found.maxDto, found.commModeBasic.byteOrder) == (8, 8, types.ByteOrder.INTEL)
    assert master.slaveProperties.supportsCalpag
    assert not master.slaveProperties.supportsDaq
    assert master.identifier(types.XcpGetIdType.FILENAME) == "stillwake"
    assert master.getStatus().resourceProtectionStatus.calpag

    master.setMta(ADDRESS)
    assert master.fetch(44) == REFERENCE.pack()
    with pytest.raises(types.XcpResponseError, match="ACCESS_LOCKED"):
        master.transport.request(types.Command.SET_REQUEST, 1, 0, 0)
    master.cond_unlock()
    assert not master.getStatus().resourceProtectionStatus.calpag

    master.setMta(EFFORT)
    master.download(struct.pack("<f", 0.25))
    assert segment.take().weights.effort == 0.25
    whole = struct.pack("<10fI", 1, 2, 3, 4, 5, 6, 7, 8, 0.05, 0.025, 2)
    assert not master.getCommModeInfo().commModeOptional.masterBlockMode
    # Its `push` does not wait for answers, even without block mode (0.29).
    master.setMta(ADDRESS)
    for begin in range(0, 44, 6):
        master.download(whole[begin : begin + 6])
    assert segment.take().weights.as_tuple() == (1, 2, 3, 4, 5, 6, 7, 8)
    master.setMta(ADDRESS)
    answer = master.buildChecksum(44)
    assert answer.checksum == checksum.check(whole, "XCP_CRC_32")

    assert master.getCalPage(1, 0) == 0
    master.setCalPage(0x83, 0, 1)
    assert segment.take() == REFERENCE
    assert master.shortUpload(4, EFFORT) == bytes(4)
    master.setCalPage(0x83, 0, 0)
    master.copyCalPage(0, 1, 0, 0)
    assert segment.in_force == REFERENCE
    master.setRequest(1, 0)
    assert slave.to_store(0) == segment.in_force
    assert master.getStatus().sessionStatus.storeCalRequest
    slave.stored()
    master.disconnect()
    assert slave.command(0, b"\xfd") == []
