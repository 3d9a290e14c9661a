"""What holds a process, a socket or a library's memory is not copied, and says so. Copies of the rest: their rooms."""

import copy
import pickle
from importlib import import_module

import pytest

HELD = (
    "wake.openfoam.plant.OpenFoamWake",
    "wake.openfoam.process.IcoFoam",
    "ecu.in_c.c_ecu.CEcu",
    "ecu.in_c.host_library.CController",
    "firmware_sim.mcu.board.board_ecu.BoardEcu",
    "firmware_sim.mcu.emulator.Machine",
    "firmware_sim.bench.real_time.live_wake.LiveWake",
    "firmware_sim.bench.virtual_loop.VirtualLoop",
    "firmware_sim.live.session.LiveSession",
    "can_bridge.bus.backends.python_can.PythonCanBus",
    "can_bridge.secoc.key.Key",
)


@pytest.mark.slow  # imports most of the rooms
def test_what_is_one_processs_alone_refuses_to_be_copied_in_a_sentence():
    for path in HELD:
        module, _, name = path.rpartition(".")
        held = object.__new__(getattr(import_module(module), name))
        for leak in (copy.copy, copy.deepcopy, pickle.dumps):
            with pytest.raises(TypeError, match=rf"^{name} can neither be copied nor pickled: \w.* [\w()]+$"):
                leak(held)
