"""What is reported of a change."""

from can_bridge.bus.interface import BusState
from can_bridge.command_gate import Intervention
from can_bridge.wire.messages import Reason
from ecu.fail_safe import OperatingMode
from firmware_sim.live.loop.noticing import BOOT, FIRST_SEEN, UNPOWERED, noticed

CONTROL = FIRST_SEEN._replace(state="CONTROL")


def test_each_change_is_reported_once():
    for now, expected in [
        (CONTROL, []),
        (CONTROL._replace(state="HOLD", reason=Reason.STREAM_LOST), ["CONTROL to HOLD: no pressures arrived"]),
        (CONTROL._replace(state="FAULT", reason=Reason.IMPLAUSIBLE), ["the pressures contradict each other; the jets"]),
        (CONTROL._replace(set_aside=("base_0",)), ["base_0 is set aside"]),
        (CONTROL._replace(given_up=True), ["the vehicle ends control"]),
        (CONTROL._replace(gate=Intervention.RATE | Intervention.RANGE), ["limited to the jets' range", "largest step"]),
        (CONTROL._replace(nodes={"ECU": BusState.BUS_OFF}), ["ECU: CAN controller bus"]),
        (CONTROL._replace(state=UNPOWERED), ["CONTROL to UNPOWERED: no supply"]),
    ]:
        kinds, texts = zip(*noticed(CONTROL, now), strict=True) if expected else ((), ())
        assert ("vehicle" in kinds) == now.given_up, now
        assert len(texts) == len(expected), now
        assert all(part in text for part, text in zip(expected, texts, strict=True)), now
        assert list(noticed(now, now)) == [], now


def test_every_state_and_reason_has_words():
    for state in (*OperatingMode.__members__, UNPOWERED, BOOT):
        before = FIRST_SEEN._replace(state="ARMED" if state == "INIT" else "INIT")
        assert len(list(noticed(before, FIRST_SEEN._replace(state=state)))) == 1
    for reason in set(Reason) - {Reason.NONE}:
        assert list(noticed(CONTROL, CONTROL._replace(reason=reason)))
