"""The texts for laypeople: what the jets do in each mode, and why they do not follow the controller."""

from collections.abc import Mapping
from typing import Final

from can_bridge.wire.messages import Reason

DOES: Final[Mapping[str, str]] = {
    "OFF": "the jets are shut",
    "WARMUP": "the jets are shut while the controller's window fills, or control is tested",
    "CONTROL": "the jets follow the controller",
    "HOLD": "the last command is held",
    "DECAY": "the command is halved each period",
    "FAULT": "the jets are shut until the request falls and rises again",
}
"""State of the jets for each mode, by the name of a `can_bridge.wire.messages.Mode`."""
BECAUSE: Final[Mapping[Reason, str]] = {
    Reason.NONE: "",
    Reason.STREAM_LOST: "no pressures arrived",
    Reason.STREAM_INVALID: "the pressure frames failed their end-to-end checks",
    Reason.DEADLINE: "its control steps came too late",
    Reason.BUS_OFF: "its CAN controller was off the bus",
    Reason.INTERNAL: "its controller gave no answer",
    Reason.SENSOR_INVALID: "a pressure was marked invalid",
    Reason.STALE: "the pressures were too old",
    Reason.NOT_AUTHENTIC: "the frames were not authentic",
    Reason.CLOCK: "its clock jumped",
    Reason.IMPLAUSIBLE: "the pressures contradict each other",
    Reason.NOT_ARMED: "the request has been high since before, and must fall and rise again",
    Reason.OTHER_ECU: "another ECU is on the bus",
    Reason.NO_RELEASE: "it has no release",
    Reason.UPDATING: "a release is being written",
    Reason.NOT_HELPING: "control did not lower the drag",
    Reason.NO_SPEED: "the vehicle's speed is not known",
    Reason.OFF_SPEED: "the vehicle is slower or faster than its release is for",
}
