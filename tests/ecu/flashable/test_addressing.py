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

    def frame(to: tuple[int, bool], data: bytes) -> Frame:
        return Frame(frame_id=to[0], is_extended=to[1], data=data.ljust(8), is_fd=frames == "fd")

    def exchange(to_ecu: list[Frame]) -> list[Frame]:
        rig.extra, rig.sent = to_ecu, []
        rig.millisecond()
        return rig.sent

    tester = IndependentTester(exchange, physical, functional, is_fd=frames == "fd")
    converse(tester, b"42")
    keeps_whole(tester, frame(ids.functional, b"\x02\x3e\x00"))
    answers = exchange([frame(ids.xcp_command, b"\xff\x00")])
    (connected,) = [one for one in answers if one.identifier == ids.xcp_response]
    assert connected.data[:1] == b"\xff"
    # Neither the other length nor the usual identifier is its own.
    number, is_extended = ids.request
    for other in ((number & 0x7FF, not is_extended), (0x7E0, False), (0x7D0, False)):
        assert [one for one in exchange([frame(other, b"\x02\x3e\x00")]) if one.identifier in ids.names] == []
