"""The bus load from the messages of the control loop and from the background traffic."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from random import Random
from typing import Final

from can_bridge.timing.background import background
from can_bridge.timing.response_time import NS_PER_MS, PeriodicMessage, Response, message_response_times
from can_bridge.wire.frame_bits import frame_ns
from can_bridge.wire.message_sets import message_set
from contract.config.tree import Config
from contract.config.vehicle import BusConfig
from contract.errors import ConfigError

_CONTENTS: Final = 16
"""Number of frames whose length is averaged; the standard error of the mean is below half a per cent."""


@dataclass(frozen=True, kw_only=True)
class MessageLoad:
    """The load of one message on the bus.

    Attributes:
        ours: whether the message belongs to the control loop, not to the background.
        worst_ns, mean_ns: time on the bus with intermission, for the longest frame and on average for random contents.
        response: worst-case response time. For the ECU's messages it begins when the ECU's compute time has passed
            since the sampling of the pressures, so it is the time that the bus adds to the age of the pressures.
    """

    message: PeriodicMessage
    ours: bool
    worst_ns: int
    mean_ns: float
    response: Response


@dataclass(frozen=True, kw_only=True)
class BusLoad:
    """The load of all messages of a bus, highest priority first.

    Attributes:
        mean, worst: shares of time for which the bus is occupied, with random contents and with the longest frames.
        left_out: see `BackgroundTraffic`.
    """

    messages: tuple[MessageLoad, ...]
    mean: float
    worst: float
    left_out: tuple[str, ...]

    @property
    def late(self) -> tuple[MessageLoad, ...]:
        return tuple(one for one in self.messages if not one.response.in_time)


def bus_load(config: Config) -> BusLoad:
    """Return loads and worst-case response times with these settings. Raises as `background` and `loop_messages` do."""
    bus = config.bus
    others = background(bus)
    ours = loop_messages(config, others.messages)
    everyone = _by_priority((*ours, *others.messages))
    names = {message.name for message in ours}
    loads = tuple(
        MessageLoad(
            message=message,
            ours=message.name in names,
            worst_ns=message.worst_ns(bus),
            mean_ns=mean_ns(message, bus),
            response=response,
        )
        for message, response in zip(everyone, message_response_times(everyone, bus), strict=True)
    )
    return BusLoad(
        messages=loads,
        mean=sum(one.mean_ns / one.message.period_ns for one in loads),
        worst=sum(one.worst_ns / one.message.period_ns for one in loads),
        left_out=others.left_out,
    )


def loop_messages(config: Config, others: Sequence[PeriodicMessage] = ()) -> tuple[PeriodicMessage, ...]:
    """Return the four messages of the control loop, highest priority first. The ECU sends its messages in answer to a
    pressure frame, so their jitter is the worst-case response time of the pressures. The command has to arrive within
    the control period minus the ECU's compute time; raises ConfigError if no time is left."""
    period_ns = config.period_ns
    if config.ecu.compute_time_ms * NS_PER_MS >= period_ns:
        raise ConfigError(
            f"ecu.compute_time_ms = {config.ecu.compute_time_ms}: must be less than a control period, "
            f"{period_ns / NS_PER_MS:g} ms"
        )
    compute_ns = round(config.ecu.compute_time_ms * NS_PER_MS)
    pressure, speed, command, status = (
        PeriodicMessage(
            name=spec.name, frame_id=spec.frame_id, is_fd=spec.is_fd, length=spec.length, period_ns=period_ns
        )
        for spec in message_set(config.bus).specs
    )
    everyone = _by_priority((pressure, speed, command, status, *others))
    arrival = message_response_times(everyone, config.bus)[everyone.index(pressure)]
    # If the pressures' response time has no bound, the answers have no bound either: their priority is lower.
    jitter_ns = period_ns if arrival.response_ns is None else arrival.response_ns
    return (
        pressure,
        speed,
        replace(command, offset_ns=compute_ns, jitter_ns=jitter_ns, deadline_ns=period_ns - compute_ns),
        replace(status, offset_ns=compute_ns, jitter_ns=jitter_ns),
    )


def mean_ns(message: PeriodicMessage, bus: BusConfig) -> float:
    """Return the mean time in ns of the message's frames over random contents, which are the same in each call."""
    random = Random(message.frame_id)
    rates = {"nominal_bitrate": bus.nominal_bitrate, "data_bitrate": bus.data_bitrate}
    frames = (message.frame(random.randbytes(message.length)) for _ in range(_CONTENTS))
    return sum(frame_ns(frame, **rates) for frame in frames) / _CONTENTS


def _by_priority(messages: Sequence[PeriodicMessage]) -> list[PeriodicMessage]:
    return sorted(messages, key=lambda message: message.priority)
