"""How long the shipped release takes over the bus, beside the vehicle's control traffic, in virtual time."""

from typing import Any, Final

from benchmarks.flash import releases
from can_bridge.bus.faults.loss import Drop
from can_bridge.flashing.backing import Backing
from can_bridge.flashing.flash_memory.flash_backing import FlashBacking
from can_bridge.flashing.flash_memory.simulated_flash import SimulatedFlash
from can_bridge.flashing.store import Store
from can_bridge.uds.access_key import AccessKey
from contract.config.tree import Config
from contract.config.vehicle import BusConfig
from firmware_sim.bench.flashing.figures import flash_time
from firmware_sim.ecu.flashable.flashable_ecu import FlashableEcu
from firmware_sim.ecu.flashable.supplies import Supplies

OLD: Final = 1
NEW: Final = 2
BUSES: Final = ("fd", "classic")
LOSSES: Final = (0.0, 0.01)
BOOT_NS: Final = 300_000_000
"""Of the ECU after a reset; a part of the time."""


def measured(frames: str, lost: float) -> dict[str, Any]:
    """One flash: kind of frames, share of the tester's frames that are lost each way, and what it took."""
    config = Config(bus=BusConfig(frames=frames))  # type: ignore[arg-type]
    ecu = FlashableEcu(_provisioned(), config, _supplies(), boot_ns=BOOT_NS)
    faults = [Drop(probability=lost, at=end) for end in ("send", "receive")] if lost else []
    found = flash_time(ecu, releases.image(NEW), config, key=AccessKey(releases.ACCESS).answer, losses=faults, seed=1)
    return {
        "frames": frames,
        "lost": lost,
        "end": found.end.name,
        "bytes": len(releases.image(NEW)),
        "seconds": found.seconds,
        "diagnostic_frames": found.frames,
        "load": found.load,
        "unanswered": found.unanswered,
        "attempts": found.attempts,
    }


def _provisioned() -> Backing:
    backing = FlashBacking(SimulatedFlash())
    Store.provision(
        backing,
        root=releases.ROOT,
        keys=releases.keys(),
        image=releases.image(OLD),
        hardware=releases.HARDWARE,
        fits=releases.fits,
    )
    return backing


def _supplies() -> Supplies:
    drawn = 0

    def random_bytes(count: int) -> bytes:
        nonlocal drawn
        drawn += 1
        return drawn.to_bytes(count, "big")

    return Supplies(
        root=releases.ROOT,
        access=AccessKey(releases.ACCESS),
        random_bytes=random_bytes,
        hardware=releases.HARDWARE,
    )
