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
from can_bridge.e2e.profiles import E2eSender
from can_bridge.e2e.receiver import E2eReceiver
from can_bridge.wire import codec
from can_bridge.wire.message_specs import JET_COMMAND, PRESSURE, VEHICLE_SPEED
from can_bridge.wire.messages import Mode, Pressure, VehicleSpeed
from contract.config.loading import load_config
from contract.release import bundle, signing
from contract.runtime.onnx_session import OnnxController
from contract.shipped import BUNDLE
from ecu.ecu import Ecu

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
    vehicle, speed, jets = E2eSender(PRESSURE), E2eSender(VEHICLE_SPEED), E2eReceiver(JET_COMMAND, config.bus.e2e)
    cruises = codec.emit_vehicle_speed(VehicleSpeed(speed_m_per_s=config.operating_point.speed, age_ns=0))
    pressure = np.array(release.manifest.scaling.pressure_mean) * config.operating_point.dynamic_pressure
    # To and fro: the plan of a wake that is its own mirror image is no action.
    aside = np.resize([1.0, -1.0], len(pressure))
    seen = []
    for k in range(release.manifest.window + 5):
        now_ns = k * config.period_ns
        # A reading that rests is taken for a dead sensor's.
        measured = Pressure(
            pressure_pa=tuple((pressure + (-1.0) ** k * aside).tolist()),
            valid=(True,) * len(pressure),
            age_ns=0,
            enable_request=k > 0,
        )
        frames = [speed.frame(cruises, now_ns=now_ns), vehicle.frame(codec.emit_pressure(measured), now_ns=now_ns)]
        answers = unit.step(now_ns, frames)
        live = jets.tick([answer for answer in answers if answer.frame_id == JET_COMMAND.frame_id]).live
        command = None if live is None else codec.parse_jet_command(live.data)
        seen.append(None if command is None else (command.mode, command.enable, command.flow_m2_per_s))
    last = seen[-1]
    if last is None or last[0] is not Mode.CONTROL or not last[1] or last[2] == 0.0:
        sys.exit(f"the ECU is not in control after {len(seen)} good frames: {seen[-3:]}")
    what = f"release {release.manifest.name} in control: {last[2]:+.4f} m2/s"
    sys.stdout.write(f"{len(names)} modules imported; {what}\n")


if __name__ == "__main__":
    main()
