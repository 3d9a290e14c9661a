"""The tester's own sequence on the simulated bus, next to the control traffic."""

from pathlib import Path

import pytest

from can_bridge.tester.messages import NotNowError
from can_bridge.tester.sequence import End
from can_bridge.wire.messages import Mode
from contract.config.tree import Config
from contract.config.vehicle import BusConfig
from tests.can_bridge.flashing.store_ecu import KEY
from tests.firmware_sim.ecu.flashable.vehicle_ecu import UNCHECKED, Rig, image, provision

pytest.importorskip("udsoncan")
from firmware_sim.ecu.flashable.flashable_ecu import FlashableEcu
from tests.proofs.flash.flash_bench import FlashBench, flash_on

BOOT_NS = 300_000_000


def made(folder: Path, config: Config) -> tuple[FlashableEcu, Rig]:
    provision(folder / "ecu", image("first"))
    rig = Rig(folder / "ecu", config, boot_ns=BOOT_NS)
    return rig.ecu, rig


@pytest.mark.slow
def test_the_time_is_that_of_the_frames(tmp_path: Path) -> None:
    length = len(image("second"))
    # Payload of a frame and its bits at 500 kbit/s and 2 Mbit/s, without stuff bits: the least it can take.
    fd, classic = length / 63 * (29 / 500e3 + 560 / 2e6), length / 7 * (111 / 500e3)
    for bus, bits in ((BusConfig(frames="fd"), fd), (BusConfig(frames="classic"), classic)):
        config = Config(bus=bus)
        ecu, rig = made(tmp_path / bus.frames, config)
        flashed = flash_on(FlashBench(ecu, config), image("second"), key=KEY.answer)
        assert (flashed.end, flashed.unanswered) == (End.CONFIRMED, 0)
        assert flashed.transferred is not None and flashed.transferred.attempts == 1
        least = bits + BOOT_NS / 1e9
        assert least < flashed.seconds < 2 * least + 1.0, bus.frames
        assert ecu.boot.bundle is not None
        assert ecu.boot.bundle.manifest.name == "second"
        assert "confirmed" in rig.log.names()


def test_a_vehicle_in_control_keeps_it(tmp_path: Path) -> None:
    ecu, rig = made(tmp_path, UNCHECKED)
    bench = FlashBench(ecu, UNCHECKED, request=lambda now_ns: now_ns > 100_000_000)
    bench.advance(2.0)
    assert bench.status is not None
    assert bench.status.state is Mode.CONTROL
    assert bench.largest_flow > 0.0
    with pytest.raises(NotNowError):
        flash_on(bench, image("second"), key=KEY.answer)
    assert bench.status.state is Mode.CONTROL
    assert "update" not in rig.log.names()
