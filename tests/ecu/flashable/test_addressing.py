"""The flashable ECU under identifiers of 11 and 29 bits, asked by clients that share no code with ours."""

import pytest

from can_bridge.wire.frame import Frame
from contract.config.tree import Config
from contract.config.vehicle import BusConfig
from tests.ecu.flashable.vehicle_ecu import Rig, image, provision
from tests.ecu.independent_tester import ADDRESSED, IndependentTester, converse, keeps_whole

pytest.importorskip("udsoncan")


@pytest.mark.slow  # boots, and hundreds of control periods
@pytest.mark.parametrize(("addressed", "frames"), [(ADDRESSED[0], "classic"), (ADDRESSED[1], "fd")])
def test_independent_clients_reach_it(tmp_path, addressed, frames):
    ids, physical, functional = addressed
    provision(tmp_path, image("one"))
    rig = Rig(tmp_path, Config(bus=BusConfig(frames=frames, diagnosis=ids)))

    def exchange(to_ecu: list[Frame]) -> list[Frame]:
        rig.extra, rig.sent = to_ecu, []
        rig.millisecond()
        return rig.sent

    tester = IndependentTester(exchange, physical, functional, is_fd=frames == "fd")
    converse(tester, b"42")
    number, is_extended = ids.functional
    is_fd = frames == "fd"
    keeps_whole(tester, Frame(frame_id=number, is_extended=is_extended, data=b"\x02\x3e\x00".ljust(8), is_fd=is_fd))
    number, is_extended = ids.xcp_command
    connect = Frame(frame_id=number, is_extended=is_extended, data=b"\xff\x00".ljust(8), is_fd=is_fd)
    (connected,) = [one for one in exchange([connect]) if one.identifier == ids.xcp_response]
    assert connected.data[:1] == b"\xff"
    # Neither the other length nor the usual identifier is its own.
    number, is_extended = ids.request
    for other in ((number & 0x7FF, not is_extended), (0x7E0, False), (0x7D0, False)):
        asked = Frame(frame_id=other[0], is_extended=other[1], data=b"\x02\x3e\x00".ljust(8), is_fd=is_fd)
        assert [one for one in exchange([asked]) if one.identifier in ids.names] == []
