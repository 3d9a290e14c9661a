"""How long the shipped release takes over the bus, next to the vehicle's control traffic, in virtual time."""

from typing import Any, Final

from can_bridge.bus.faults.loss import Drop
from can_bridge.flashing.flash_memory.flash_backing import FlashBacking
from can_bridge.flashing.flash_memory.simulated_flash import SimulatedFlash
from contract.config.tree import Config
from contract.config.vehicle import BusConfig
from contract.release.signing import public_key
from firmware_sim.ecu.flashable.equipment import Equipment
from firmware_sim.ecu.flashable.flashable_ecu import FlashableEcu
from tests.can_bridge.flashing.releases import HARDWARE, ROOT, provision
from tests.can_bridge.flashing.store_ecu import KEY, Counted
from tests.proofs.flash.flash_bench import FlashBench, flash_on
from tests.proofs.flash.releases import NEW, OLD, shipped

BUSES: Final = ("fd", "classic")
LOSSES: Final = (0.0, 0.01)
BOOT_NS: Final = 300_000_000
"""Time that the ECU takes to boot after a reset."""


def measured(frames: str, lost: float) -> dict[str, Any]:
    """One flash: kind of frames, share of the tester's frames that are lost each way, and what it took."""
    config = Config(bus=BusConfig(frames=frames))  # type: ignore[arg-type]
    equipment = Equipment(root=public_key(ROOT), access=KEY, random_bytes=Counted(), hardware=HARDWARE)
    memory = provision(FlashBacking(SimulatedFlash()), shipped(OLD))
    ecu = FlashableEcu(memory, config, equipment, boot_ns=BOOT_NS)
    faults = [Drop(probability=lost, at=end) for end in ("send", "receive")] if lost else []
    bench = FlashBench(ecu, config, losses=faults, seed=1)
    flashed = flash_on(bench, shipped(NEW), key=KEY.answer)
    return {
        "frames": frames,
        "lost": lost,
        "end": flashed.end.name,
        "bytes": len(shipped(NEW)),
        "seconds": flashed.seconds,
        "diagnostic_frames": bench.diagnostic_frames,
        "load": bench.bus.activity().load,
        "unanswered": flashed.unanswered,
        "attempts": 0 if flashed.transferred is None else flashed.transferred.attempts,
    }
