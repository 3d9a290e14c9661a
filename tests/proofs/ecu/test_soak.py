"""The soak adds up where nothing is wrong, and finds what was planted."""

import gc
import mmap
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import PRESSURE
from contract.arrays import Array
from contract.controller.interface import ControlStep
from contract.release import bundle
from contract.release.checks import Bundle
from firmware_sim.ecu.ecu import Ecu
from firmware_sim.ecu.ecu_state import EcuState
from tests.proofs.ecu import soak
from tests.proofs.ecu.replay import ReplayedPlant
from tests.proofs.ecu.witness import COUNTERS, Passed

PERIODS = 880
"""17.6 s, with a pause and a bus-off after 16 s in place of a minute."""


class Wanders:
    """Plans that move, without ONNX Runtime's milliseconds."""

    description = "a sine"

    def __init__(self) -> None:
        self._calls = 0

    def control_step(self, window: Array, plan: Array, free: Array, weights: Array | None = None) -> ControlStep:
        self._calls += 1
        new = 0.03 * np.sin(0.1 * (self._calls + np.arange(len(plan))))
        shifted = np.append(plan[1:], plan[-1])
        return ControlStep(
            plan=np.where(free > 0.5, new, shifted), forces=np.zeros((len(plan), 2)), terms=np.zeros(7), cost=0.0
        )


@pytest.fixture
def release(random_release: Path) -> Bundle:
    return bundle.load(random_release)


def soaked(release: Bundle, periods: int = PERIODS, **options: Any) -> soak.Soaked:
    config = soak.settings_of(release)
    # The test bundle is of the paper's operating point, which is the default; a few MB are the first use of everything.
    return soak.soak(release, Wanders(), config, periods=periods, seed=4, **{"most_growth_mb": 30.0, **options})


@pytest.mark.slow  # seconds of the whole loop
def test_everything_adds_up_and_every_counter_moves(release: Bundle, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(soak, "_BUS_OFF_EVERY_NS", 16_000_000_000)
    monkeypatch.setattr(soak, "_STANDBY_EVERY", 800)
    figures, failures = soaked(release)
    assert failures == ()
    assert figures["statuses_compared"] > 0.9 * PERIODS
    for name in COUNTERS:
        assert figures[f"said_{name}"] == figures[f"counted_{name}"] > 0, name
    assert figures["said_bus_off"] > 0
    assert figures["periods_in_control"] > PERIODS // 2


@pytest.mark.proofs
def test_an_hour_adds_up(release: Bundle) -> None:
    """With plans that a sine makes; the command takes the shipped release."""
    assert soaked(release, 180_000, most_growth_mb=soak.MOST_GROWTH_MB).failures == ()


@pytest.mark.slow  # likewise
def test_counters_that_forget_one_and_memory_that_grows_are_found(
    release: Bundle, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each counter is one too low, and each step keeps 1 MB.

    Maps of their own hold that, so that what earlier tests freed is not used for them; what they left goes first.
    """
    status, step, kept = EcuState.status, Ecu.step, list[mmap.mmap]()

    def forgets(state: EcuState, bundle_hash: int) -> Any:
        honest = status(state, bundle_hash)
        return honest._replace(**{name: max(0, getattr(honest, name) - 1) for name in COUNTERS})

    def hoards(ecu: Ecu, *arguments: Any) -> list[Frame]:
        pages = mmap.mmap(-1, 1_000_000)
        pages.write(b"\x01" * 1_000_000)
        kept.append(pages)
        return step(ecu, *arguments)

    monkeypatch.setattr(EcuState, "status", forgets)
    monkeypatch.setattr(Ecu, "step", hoards)
    gc.collect()
    figures, failures = soaked(release, 400, most_growth_mb=20.0)
    for name in COUNTERS:
        assert figures[f"said_{name}"] == figures[f"counted_{name}"] - 1, name
    for text in ("counters differ", "memory grew by"):
        assert any(text in line for line in failures), failures


@pytest.mark.slow  # likewise
def test_a_frame_that_no_fault_took_is_missed(release: Bundle, monkeypatch: pytest.MonkeyPatch) -> None:
    honest, taken = Passed.receive_all, False
    nearest: list[Passed] = []

    def loses(port: Passed) -> list[Frame]:
        nonlocal taken
        frames = honest(port)
        if any(map(PRESSURE.names, frames)) and not nearest:
            nearest.append(port)  # to the bus: it returns first, and the ECU's faults are behind it
        if taken or port not in nearest or port.received[PRESSURE.frame_id] < 20:
            return frames
        taken = True
        return [frame for frame in frames if not PRESSURE.names(frame)]

    monkeypatch.setattr(Passed, "receive_all", loses)
    figures, failures = soaked(release, 100)
    assert taken and figures["frames_unaccounted"] == 1
    assert any("that no fault took" in line for line in failures), failures


def test_the_recording_is_replayed_to_and_fro() -> None:
    names = ("t", "Cd", "Cl", "Cd_slot_pressure", "Cd_slot_viscous", "Cd_momentum", "jet_power", "Uy_probe")
    plant = ReplayedPlant(dict.fromkeys(names, np.arange(4.0)) | {"Cp": np.zeros((4, 3))}, 0.2)
    seen = []
    for k in range(13):
        seen.append(plant.sample())
        plant.advance_to(10)
        plant.advance_to(30, 0.01 * k)
    assert [sample.Cd for sample in seen] == [0, 1, 2, 3, 2, 1, 0, 1, 2, 3, 2, 1, 0]
    assert [sample.action for sample in seen] == [0.0, *(0.01 * k for k in range(12))]
    assert [sample.t for sample in seen] == pytest.approx(0.2 * np.arange(13))
