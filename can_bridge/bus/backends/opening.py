"""From the settings of a bus to an open python-can bus."""

from collections.abc import Mapping
from typing import Any, Final

import can

from contract.config.vehicle import SIMULATED, BusConfig
from contract.errors import BusError, install

QUEUE_SIZE: Final = 1024
"""Frames a virtual bus holds for a reader, and the most one `receive_all` returns."""

SETTLE_S: Final = 2.0
"""What a serial adapter is given to start after its port was opened; many reset then."""

OWN_CONFIGURATION: Final = "python-can"
"""In place of an interface: the one that python-can's configuration names (can.conf, environment)."""

_SAMPLE_POINT: Final = 80.0
"""Percent, for both bit rates, where this adapter sets the bit timing."""
_CLOCK_HZ: Final = 80_000_000

_OF_EXTRA_BUS: Final = ("udp_multicast", "slcan")
"""Interfaces whose packages the base install leaves out."""


def open_backend(config: BusConfig, *, settle_s: float = SETTLE_S) -> tuple[can.BusABC, str]:
    """Connect as configured: an open bus, and python-can's name of its interface, also where that chose it. Raises
    BusError naming interface and channel, if that cannot be opened. `settle_s` is what a serial adapter is given to
    start, in s."""
    _check_known(config.interface)
    # Vendors' drivers raise what they like, also where their library is missing.
    try:
        interface, options = _settings(config, settle_s)
        return _constructed(interface, options), interface
    except Exception as error:
        hint = ""
        missing = isinstance(error, ImportError | can.CanInterfaceNotImplementedError)
        if missing and config.interface in _OF_EXTRA_BUS:
            hint = f"; {install('bus')}"
        raise BusError(f"CAN bus {config.interface} {config.channel!r}: {one_line(error)}{hint}") from error


def one_line(error: BaseException) -> str:
    """An error's message on one line, or else its kind."""
    return " ".join(str(error).split()) or type(error).__name__


def _check_known(interface: str) -> None:
    known = (OWN_CONFIGURATION, *sorted(can.VALID_INTERFACES))
    if interface not in known:
        is_ours = interface == SIMULATED
        reason = "it is in virtual time and connects nothing real" if is_ours else "python-can does not know it"
        allowed = known if is_ours else (SIMULATED, *known)
        raise BusError(f"bus.interface = {interface}: {reason}; must be one of {', '.join(allowed)}")


def _settings(config: BusConfig, settle_s: float) -> tuple[str, dict[str, Any]]:
    """The interface's name, and what to open it with."""
    if config.interface == OWN_CONFIGURATION:
        options: dict[str, Any] = {**can.util.load_config(context=config.channel)}
        return options.pop("interface"), {name: value for name, value in options.items() if value is not None}
    return config.interface, {"channel": config.channel, **_options(config, settle_s)}


def _options(config: BusConfig, settle_s: float) -> Mapping[str, Any]:
    is_fd = config.frames == "fd"
    match config.interface:
        case "virtual":
            protocol = can.CanProtocol.CAN_FD if is_fd else can.CanProtocol.CAN_20
            return {"rx_queue_size": QUEUE_SIZE, "preserve_timestamps": True, "protocol": protocol}
        case "udp_multicast":
            return {"hop_limit": 0}
        case "slcan" if is_fd:
            timing = can.BitTimingFd.from_sample_point(
                f_clock=_CLOCK_HZ,
                nom_bitrate=config.nominal_bitrate,
                nom_sample_point=_SAMPLE_POINT,
                data_bitrate=config.data_bitrate,
                data_sample_point=_SAMPLE_POINT,
            )
            return {"timing": timing, "sleep_after_open": settle_s}
        case "slcan":
            return {"bitrate": config.nominal_bitrate, "sleep_after_open": settle_s}
        case "socketcan":
            return {"fd": is_fd}
    rates = {"bitrate": config.nominal_bitrate, **({"data_bitrate": config.data_bitrate} if is_fd else {})}
    return {"fd": is_fd, **rates}


def _constructed(interface: str, options: dict[str, Any]) -> can.BusABC:
    """Ours where python-can's own backend does not survive what may come over the wire."""
    if interface == "udp_multicast":
        from can_bridge.bus.backends.udp_multicast import UdpMulticastBus

        return UdpMulticastBus(**options)
    if interface == "slcan":
        from can_bridge.bus.backends.slcan import SlcanBus

        return SlcanBus(**options)
    return can.Bus(interface=interface, ignore_config=True, **options)
