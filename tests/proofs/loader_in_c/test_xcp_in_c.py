"""XCP of the node in C and another library's master: it unlocks, writes, stores, and measures what the A2L names."""

import struct
from pathlib import Path

import pytest

from can_bridge.calibration.a2l import a2l_text
from can_bridge.calibration.segment import ADDRESS, Segment
from can_bridge.uds.services import Did
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import message_set
from can_bridge.wire.messages import Mode
from contract.controller.calibration import CALIBRATION_NAMES
from ecu.calibrating import limits_of, release_calibration
from tests.can_bridge.flashing.store_ecu import KEY
from tests.can_bridge.uds.addresses import COMMAND_ID, XCP_RESPONSE_ID
from tests.proofs.loader_in_c.node_library import Library, build, sources
from tests.proofs.loader_in_c.node_slow import Slow
from tests.proofs.loader_in_c.node_twin import CONFIGS, MS, world

xcp_master = pytest.importorskip("tests.can_bridge.calibration.test_xcp_master")
pytestmark = pytest.mark.compiler


class Node(Slow):
    """A node that a calibration tool asks, and a tester beside it."""

    def command(self, data: bytes) -> list[bytes]:
        sent = self.node.service(self.now_ns, [Frame(frame_id=COMMAND_ID, data=data, is_fd=True)])
        self.now_ns += MS
        return self.to_tool(sent)

    def to_tool(self, frames: list[Frame]) -> list[bytes]:
        return [frame.data for frame in frames if frame.frame_id == XCP_RESPONSE_ID]


@pytest.mark.slow  # builds a library
def test_a_master_calibrates_and_measures_the_node(tmp_path: Path) -> None:
    contents = sources(CONFIGS["fd"])
    of = world("fd", Library(contents, build(contents, tmp_path / "fd", "fd.so")))
    node = Node(of)
    own = release_calibration(of.bundle, of.config)
    segment = Segment(own, limits_of(of.bundle, of.config))
    text = a2l_text(segment, release="r", bus=of.config.bus, period_ns=of.config.period_ns)
    measured = xcp_master.measurements(text)
    messages = message_set(of.config.bus)
    effort, place = 0.25, ADDRESS + 4 * CALIBRATION_NAMES.index("effort")
    with xcp_master.connection(node.command, KEY, measured) as (master, bus, periods):
        master.connect()
        assert master.identifier(xcp_master.types.XcpGetIdType.FILENAME) == "stillwake"
        master.setMta(ADDRESS)
        assert master.fetch(44) == own.pack()
        with pytest.raises(xcp_master.types.XcpResponseError, match="ACCESS_LOCKED"):
            master.transport.request(xcp_master.types.Command.SET_REQUEST, 1, 0, 0)
        master.cond_unlock()
        master.setMta(place)
        master.download(struct.pack("<f", effort))
        # What one of the two wrote is what the other one reads.
        ((_, answer),) = node.ask(b"\x22" + Did.CALIBRATION.to_bytes(2, "big"))
        assert struct.unpack_from("<f", answer, 3 + place - ADDRESS) == (effort,)
        master.setMta(ADDRESS)
        assert master.buildChecksum(44).checksum == xcp_master.checksum.check(answer[3:], "XCP_CRC_32")
        periods.setup()
        periods.start()
        node.asks = False
        for asks in 5 * [False] + 40 * [True]:
            node.asks = asks
            command = messages.command.parse(node.period()[0].data)
            assert command is not None
            node.now_ns += 17 * MS
            for _ in range(3):
                bus.put(node.to_tool(node.node.service(node.now_ns, [])))
                node.now_ns += MS
            row = periods.rows.get(timeout=10)
            assert row["mode"] == command.mode
            scale = of.config.operating_point.flow_rate_scale
            assert row["command"] == pytest.approx(command.flow_m2_per_s / scale, abs=1e-6)
            assert row["effort_in_force"] == effort and row["rate_in_force"] == own.weights.rate
        assert command is not None and command.mode is Mode.CONTROL and row["command"] != 0.0
        dynamic = of.config.operating_point.dynamic_pressure
        pressures = [row[f"pressure_{sensor}"] for sensor in range(1, 5)]
        assert pressures == pytest.approx([pressure / dynamic for pressure in (30.0, 60.0, 90.0, 10.0)], rel=1e-6)
        periods.stop()
        # Stored once the jets are shut.
        master.setRequest(1, 0)
        assert master.getStatus().sessionStatus.storeCalRequest
        node.asks = False
        node.control(5)
        assert not master.getStatus().sessionStatus.storeCalRequest
        assert node.ask(b"\x22" + Did.CALIBRATION_STORED.to_bytes(2, "big"))[-1][1][3:] == b"\x01"
