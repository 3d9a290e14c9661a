"""How long flashing takes on a bus with a vehicle's control traffic, in virtual time."""

from collections.abc import Sequence
from dataclasses import dataclass

from udsoncan.client import Client

from can_bridge.bus.faults.fault import Fault
from can_bridge.tester.asking import KeyOf
from can_bridge.tester.sequence import End, Flashed, flash
from can_bridge.uds.services import REQUEST_ID, RESPONSE_ID
from can_bridge.wire.frame import Frame
from contract.config.tree import Config
from firmware_sim.bench.flashing.flash_bench import Faults, FlashBench
from firmware_sim.bench.flashing.tester_connection import BenchConnection
from firmware_sim.ecu.flashable.flashable_ecu import FlashableEcu


@dataclass(frozen=True, kw_only=True)
class FlashTime:
    """What one flash took, from the first request to the confirmation.

    Attributes:
        end: how it ended.
        seconds: of virtual time.
        frames: of diagnosis on the bus, both ways.
        load: share of the bus's time that was taken, control traffic included.
        unanswered: requests that were sent again for want of an answer.
        attempts: announcements that the ECU took.
        periods: control steps meanwhile.
    """

    end: End
    seconds: float
    frames: int
    load: float
    unanswered: int
    attempts: int
    periods: int


def flash_time(
    ecu: FlashableEcu, image: bytes, config: Config, *, key: KeyOf, losses: Sequence[Fault] = (), seed: int = 0
) -> FlashTime:
    """Flash an image by the sequence of `stillwake flash`, with frames lost on the tester's connection.

    Args:
        ecu: just powered on.
        config: of the vehicle, its bus included.
        key: answers a seed of the programming level.
        losses: faults of the tester's port.
        seed: of these.

    Raises:
        FlashError: it did not end well.
    """
    frames = 0

    def count(frame: Frame) -> None:
        nonlocal frames
        frames += frame.frame_id in (REQUEST_ID, RESPONSE_ID)

    bench = FlashBench(ecu, config, faults=Faults(tester=losses, seed=seed), capture=count)
    flashed = flash_on(bench, image, key=key)
    return FlashTime(
        end=flashed.end,
        seconds=flashed.seconds,
        frames=frames,
        load=bench.bus.activity().load,
        unanswered=flashed.unanswered,
        attempts=0 if flashed.transferred is None else flashed.transferred.attempts,
        periods=bench.periods,
    )


def flash_on(bench: FlashBench, image: bytes, *, key: KeyOf) -> Flashed:
    """Run the tester's sequence in the bench's time; raises FlashError."""
    with Client(BenchConnection(bench)) as client:
        return flash(client, image, key=key, clock=lambda: bench.bus.now_ns / 1e9, sleep=lambda s: _pass(bench, s))


def _pass(bench: FlashBench, seconds: float) -> None:
    bench.advance(seconds)
