"""A virtual bus in this process, and what the tests of several commands do with it."""

import time
from pathlib import Path
from typing import Any

import can

import contract

DBC = Path(contract.__file__).parent / "stillwake.dbc"
VIRTUAL = ("--set", "bus.interface=virtual", "--set", "bus.channel=test-can")


def taken(peer: can.BusABC) -> list[can.Message]:
    found = []
    while (message := peer.recv(timeout=0.0)) is not None:
        found.append(message)
    return found


def flat(text: str) -> str:
    return " ".join(text.split())


def send_when_heard(peer: can.BusABC, messages: list[can.Message]) -> None:
    """A virtual bus keeps nothing for those who come later."""
    deadline = time.monotonic() + 30.0
    while len(nodes()) < 2 and time.monotonic() < deadline:
        time.sleep(0.01)
    for message in messages:
        peer.send(message)


def nodes() -> list[Any]:
    from can.interfaces.virtual import channels

    return list(channels.get("test-can", []))
