"""A small release with its C library, the ECU in it, and frames to feed ECUs of it by hand."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from can_bridge.secoc.securing import Authentication
from can_bridge.wire.frame import Frame
from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig
from contract.config.tree import Config
from contract.config.vehicle import EcuConfig, SensorCheckConfig
from contract.controller.c_folder import ECU_SETTINGS
from contract.release import bundle as bundles
from contract.release.checks import Bundle
from contract.release.manifest import SpeedRange
from ecu.c.sources import firmware_sources
from ecu.in_c.c_settings import ecu_settings
from ecu.in_c.host_library import CController
from ecu.in_c.uds_settings import UDS_SETTINGS, uds_settings
from examples.random_programs import random_program
from export.int8 import rounded_on
from export.program.controller_program import random_window
from export.release.gated import gate, lower
from export.release.pipeline import CLibrary, write_c_release
from tests.conftest import write_random
from tests.ecu.conftest import ByHand

CONFIG = Config(ecu=EcuConfig(sensor_check=SensorCheckConfig(enabled=False)))
WINDOW = 4
MODEL = ModelConfig(window=WINDOW, latent=3, lstm_width=8, dynamics_width=16, decoder_width=8)


@dataclass(frozen=True)
class Exported:
    bundle: Bundle
    bundle_path: Path
    folder: Path

    def serving(self, speeds: SpeedRange) -> "Exported":
        return replace(self, bundle=replace(self.bundle, manifest=replace(self.bundle.manifest, speeds=speeds)))


def exported(root: Path) -> Exported:
    """Bundle and library of a random program in int8."""
    program = random_program(1, model=MODEL, mpc=MpcConfig(horizon=8), prior_memory=WINDOW)
    rng = np.random.default_rng(0)
    rows = np.concatenate([random_window(program, rng) for _ in range(8)])
    windows = [rows[i : i + WINDOW] for i in range(20)]
    lowered = lower(rounded_on(program, windows), calibration=windows, with_library=True)
    compiled = partial(CController, flags=("-O1", "-ffp-contract=off"))  # as the known answer is
    gated = gate(lowered, windows[:4], {"rms_action_error": 0.05, "max_cost_gap": 1.0}, compiled=compiled)
    write_random(root / "bundle", gated)
    bundle = bundles.load(root / "bundle")
    ecu = firmware_sources() | {ECU_SETTINGS: ecu_settings(bundle, CONFIG)}
    ecu[f"loader/{UDS_SETTINGS}"] = uds_settings()
    library = CLibrary(folder=root / "c", compiled=compiled, ecu=lambda *_: ecu)
    write_c_release(library, bundle, gated, windows[:4])
    return Exported(bundle, root / "bundle", root / "c")


class Feed(ByHand):
    """Frames of a vehicle whose pressures swing, a period apart."""

    def __init__(self, config: Config = CONFIG, authentication: Authentication | None = None) -> None:
        super().__init__(config, authentication)
        self.asks = True

    def frame(self, *, damaged: bool = False) -> Frame:
        """Pressures of now; the request rises in the second frame."""
        swing = 0.3 * np.sin(0.3 * self.frames_sent + np.arange(4))
        frame = self.pressures(swing, asks=self.frames_sent > 0 and self.asks)
        return replace(frame, data=frame.data[:-1] + bytes([frame.data[-1] ^ 1])) if damaged else frame

    def driven(self, ratios: Sequence[float | None]):
        """(time, frames) of a period at each of these speeds; None where no speed comes."""
        for ratio in ratios:
            yield self.now_ns, [*([] if ratio is None else [self.at_speed(ratio, density=1.1)]), self.frame()]
            self.now_ns += self.config.period_ns

    def periods(self, count: int, *, lost: tuple[int, ...] = (), damaged: tuple[int, ...] = ()):
        """(time, frames) of so many periods; the frames of some are lost or damaged."""
        for k in range(count):
            frame = self.frame(damaged=k in damaged)
            yield self.now_ns, [] if k in lost else [frame]
            self.now_ns += self.config.period_ns
