"""What a vehicle installs is enough for an ECU: run by `make pristine` where the base package stands alone.

Imports every module of the rooms that a vehicle runs, loads the shipped release, and feeds an ECU the release's mean
pressures as protected frames until it is in control. Ends with status 1 and one line if anything is missing.
"""

import importlib
import importlib.util
import pkgutil
import sys
from types import ModuleType

import numpy as np

import can_bridge
import contract
import ecu
from can_bridge.wire.messages import Mode
from contract.config.loading import load_config
from contract.release import bundle, signing
from contract.runtime.onnx_session import OnnxController
from contract.sensors import TRUCK
from contract.shipped import BUNDLE
from ecu.ecu import Ecu
from firmware_sim.bench.vehicle_node import VehicleNode

EXTRAS = ("torch", "shap", "onnx", "numba", "scipy", "matplotlib", "gymnasium", "distributed", "PIL", "pytest", "h5py",
          "udsoncan", "isotp")  # fmt: skip
"""What only the other extras bring; here it must be missing, or the run proves nothing."""
ELSEWHERE = ("contract.recording", "stillwake_data", "can_bridge.tester.transport")
"""Data sets and what reads them, and a tester's connection, which is udsoncan's: no part of the base install."""


def modules(room: ModuleType) -> list[str]:
    found = [found.name for found in pkgutil.walk_packages(room.__path__, f"{room.__name__}.")]
    return [name for name in found if not name.startswith(ELSEWHERE)]


def main() -> None:
    present = [name for name in EXTRAS if importlib.util.find_spec(name) is not None]
    if present:
        sys.exit(f"{', '.join(present)}: installed here, so this is not the base package alone")
    names = [name for room in (contract, can_bridge, ecu) for name in modules(room)]
    for name in names:
        importlib.import_module(name)

    config = load_config(None, [])
    release = bundle.load(BUNDLE, signing.project_key())
    unit = Ecu(release, OnnxController.of(release), config)
    vehicle, mean = VehicleNode(release.manifest.sensors, config), np.array(release.manifest.scaling.pressure_mean)
    wall, columns = np.zeros(len(TRUCK)), TRUCK.indices(release.manifest.sensors)
    # To and fro: the plan of a wake that is its own mirror image is no action, and a reading that rests is taken for a
    # dead sensor's.
    aside = np.resize([1.0, -1.0], len(mean)) / config.operating_point.dynamic_pressure
    for k in range(release.manifest.window + 5):
        now_ns = k * config.period_ns
        wall[columns] = mean + (-1.0) ** k * aside
        speed = vehicle.speed_frame(now_ns=now_ns)
        sampled = vehicle.sample(wall, enable_request=k > 0, now_ns=now_ns)
        answers = unit.step(now_ns, [*([] if speed is None else [speed]), sampled])
        jets = vehicle.apply_commands(answers)
    if unit.trace.mode is not Mode.CONTROL or jets.action == 0.0:
        sys.exit(f"the ECU is in {unit.trace.mode.name} after {k + 1} good frames: {unit.state.fail_safe}")
    what = f"release {release.manifest.name} in control: {jets.action:+.2g} U_inf W"
    sys.stdout.write(f"{len(names)} modules imported; {what}\n")


if __name__ == "__main__":
    main()
