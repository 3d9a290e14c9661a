"""The slave and pyxcp's master, on a bus that answers at once."""

import logging
import queue
import struct
from collections.abc import Iterator
from typing import Any

import can
import numpy as np
import pytest

from can_bridge.calibration.a2l import a2l_text
from can_bridge.calibration.daq import measured_bytes
from can_bridge.calibration.segment import ADDRESS
from can_bridge.flashing.state import Level
from can_bridge.wire.messages import Mode, Reason
from contract.config.vehicle import BusConfig
from tests.can_bridge.calibration.conftest import REFERENCE
from tests.can_bridge.calibration.test_a2l import read
from tests.can_bridge.flashing.store_ecu import KEY
from tests.can_bridge.uds.addresses import COMMAND_ID, XCP_RESPONSE_ID

config = pytest.importorskip("pyxcp.config")
masters = pytest.importorskip("pyxcp.master")
types = pytest.importorskip("pyxcp.types")
daq_stim = pytest.importorskip("pyxcp.daq_stim")
checksum = pytest.importorskip("pyxcp.checksum")
EFFORT = ADDRESS + 20
TYPES = {"FLOAT32_IEEE": "F32", "UBYTE": "U8", "SBYTE": "I8", "ULONG": "U32"}


class SlaveBus(can.BusABC):
    """A slave that answers each command, behind python-can's interface; `put` is what comes unasked."""

    def __init__(self, slave):
        self._slave = slave
        self._queue: queue.Queue[can.Message] = queue.Queue()
        super().__init__(channel=0)

    def send(self, msg, timeout=None):
        assert msg.arbitration_id == COMMAND_ID
        self.put(self._slave.command(0, bytes(msg.data)))

    def put(self, packets):
        for packet in packets:
            self._queue.put(can.Message(arbitration_id=XCP_RESPONSE_ID, data=packet, is_extended_id=False))

    def _recv_internal(self, timeout):
        try:
            return self._queue.get(timeout=timeout), False
        except queue.Empty:
            return None, False


class Periods(daq_stim.DaqOnlinePolicy):  # type: ignore[name-defined,misc]
    """Measures these values (name, address, extension, type); `rows` has those of each period."""

    def __init__(self, measured):
        own = daq_stim.DaqList("period", event_num=0, stim=False, enable_timestamps=False, measurements=measured)
        super().__init__([own], logger=logging.getLogger("pyxcp"))
        self.pid_off = False
        self.rows: queue.Queue[dict[str, float]] = queue.Queue()

    def on_daq_list(self, daq_list, timestamp0, timestamp1, payload):
        self.rows.put(dict(zip((name for name, *_ in self.daq_lists[0].headers), payload, strict=True)))


@pytest.fixture
def bus(slave) -> Iterator[SlaveBus]:
    made = SlaveBus(slave)
    yield made
    made.shutdown()
    config.reset_application()


def test_a_master_connects_reads_writes_stores_and_measures_all_that_the_file_names(slave, segment, bus):
    ids = {"can_id_master": COMMAND_ID, "can_id_slave": XCP_RESPONSE_ID, "interface": "virtual"}
    application = config.create_application_from_config({"Transport": {"CAN": ids}}, log_level=logging.ERROR)
    application.general.seed_n_key_function = lambda resource, seed: KEY.answer(Level.CALIBRATION, seed)
    text = a2l_text(segment, release="r", bus=BusConfig(), period_ns=20_000_000)
    blocks = read(text).one("PROJECT").one("MODULE").all("MEASUREMENT")
    measured = [(one.words[0], int(one.after("ECU_ADDRESS"), 16), 0, TYPES[one.words[2]]) for one in blocks]
    periods = Periods(measured)
    with masters.Master("can", config=application, policy=periods, transport_layer_interface=bus) as master:
        found = master.connect()
        assert (found.maxCto, found.maxDto, found.commModeBasic.byteOrder) == (8, 8, types.ByteOrder.INTEL)
        assert master.slaveProperties.supportsCalpag and master.slaveProperties.supportsDaq
        assert master.identifier(types.XcpGetIdType.FILENAME) == "stillwake"
        assert master.getStatus().resourceProtectionStatus.calpag

        master.setMta(ADDRESS)
        assert master.fetch(44) == REFERENCE.pack()
        with pytest.raises(types.XcpResponseError, match="ACCESS_LOCKED"):
            master.transport.request(types.Command.SET_REQUEST, 1, 0, 0)
        master.cond_unlock()
        assert not master.getStatus().resourceProtectionStatus.calpag

        assert not master.getCommModeInfo().commModeOptional.masterBlockMode
        master.setMta(EFFORT)
        master.download(struct.pack("<f", 0.25))
        assert segment.take().weights.effort == 0.25
        master.setMta(ADDRESS)
        assert master.buildChecksum(44).checksum == checksum.check(segment.in_force.pack(), "XCP_CRC_32")

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

        def period(number):
            pressures = np.array([number, 0.25, -0.5, 0.75])
            states: dict[str, Any] = {"mode": Mode.CONTROL, "reason": Reason.STALE, "gated": 5}
            slave.daq.sample(measured_bytes(pressures, 0.0625, **states, calibration=REFERENCE))
            slave.daq.look()
            return slave.daq.packets(99)

        periods.setup()
        periods.start()
        assert master.getStatus().sessionStatus.daqRunning
        for number in (1.0, 2.0):
            bus.put(period(number))
            row = periods.rows.get(timeout=10)
            assert [row[name] for name, *_ in measured] == pytest.approx(
                [number, 0.25, -0.5, 0.75, 0.0625, Mode.CONTROL, Reason.STALE, 5, 0, *REFERENCE.values]
            )
        periods.stop()
        assert period(3.0) == []
        master.disconnect()
        assert slave.command(0, b"\xfd") == []
