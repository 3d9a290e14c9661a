r"""
What a fault does to the loop
=============================

For validation engineers who want to see what the ECU does when a sensor dies and the bus loses frames, before they read
its table of states. At its end you have run the closed loop twice, healthy and with faults, and can put any other fault
in the place of these.

The flow is computed while the page is made, on a coarser mesh than the default one and for a short time. The last
section shows what that costs.
"""

# %%
# The release, the vehicle and the wake
# -------------------------------------
# The shipped release goes into the simulated ECU. Of the meshes that are coarser than the default, 0.75 is the one on
# which the controller is worth as much as on that. The shipped wake is interpolated to it, and runs freely for a
# moment to forget that.

import matplotlib.pyplot as plt
import numpy as np
from rich import print

from contract.config.loading import load_config
from contract.release import bundle
from contract.shipped import BUNDLE
from wake.truck.develop import moved
from wake.truck.state import developed_state
from wake.truck.truck_wake import TruckWake

config = load_config(None, ["flow.refinement=0.75", "flow.substeps=15"])
release = bundle.load(BUNDLE)
wake = TruckWake(config.flow)
start = moved(developed_state(), TruckWake().grid, wake, duration=4.0)
print(f"{release.manifest.name} reads {', '.join(release.manifest.sensors)}")
print(wake.description)

# %%
# Two runs
# --------
# A run is a function of release, settings, start and disturbances, all in virtual time: the same on any machine. The
# vehicle sends the pressures over a simulated CAN FD bus every 20 ms, the ECU answers with a command and with its
# status, and the jets follow. Control is requested from 1.3 s on. A disturbance is a line of text, with its times in
# s:
#
# - one sensor on the base reads Cp 0 from 2.5 s on,
# - and from 3.8 s on the vehicle's frames are lost, half of them, at random but from a seed.

from can_bridge.wire import codec
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import ECU_STATUS
from firmware_sim.bench.disturbances import Disturbances
from firmware_sim.bench.simulation import Simulation
from firmware_sim.bench.spans import Spans
from firmware_sim.runs.run_log import RunLog

FAULTS = ("dead:sensor=base_9@2.5..", "vehicle:drop:probability=0.5@3.8..")
spans = Spans(lead_in=13.0, controlled=35.0, settle=0.0, averages=False)


def run(disturbances: tuple[str, ...]) -> tuple[RunLog, list[tuple[float, int]]]:
    """A run, and (time in s, sensors set aside as bits) of every status of the ECU."""
    statuses: list[tuple[float, int]] = []

    def heard(frame: Frame) -> None:
        if frame.frame_id == ECU_STATUS.frame_id and (status := codec.parse_ecu_status(frame.data)) is not None:
            statuses.append((frame.timestamp_ns / 1e9, status.set_aside))

    wake.reset(start)
    simulation = Simulation(release, config, spans=spans, disturbances=Disturbances.parse(disturbances), seed=1)
    return simulation.run(wake, capture=heard), statuses


healthy, _ = run(())
faulty, statuses = run(FAULTS)

# %%
# What happened
# -------------
# The strip shows the ECU's state in the run with faults. Until the first fault the two runs are one.

from matplotlib.patches import Patch

from can_bridge.wire.messages import Mode, Reason

COLOURS = {
    Mode.OFF: "0.85",
    Mode.WARMUP: "#9ecae1",
    Mode.CONTROL: "#4daf4a",
    Mode.HOLD: "#ffd92f",
    Mode.DECAY: "#ff7f00",
    Mode.FAULT: "#e41a1c",
}
# 1 t_c is 0.1 s for a truck 2.5 m wide at 25 m/s.
seconds = (faulty.series["t"] - faulty.series["t"][0]) * config.operating_point.convective_time
period = float(seconds[1])
modes = [Mode(int(mode)) for mode in faulty.series["mode"]]

figure, (strip, drag, lift, action) = plt.subplots(
    4, 1, sharex=True, figsize=(8, 7), height_ratios=(0.3, 2, 2, 2), layout="constrained"
)
for moment, mode in zip(seconds, modes, strict=True):
    strip.axvspan(moment, moment + period, color=COLOURS[mode], linewidth=0)
strip.set_yticks([])
strip.legend(
    handles=[Patch(color=colour, label=mode.name) for mode, colour in COLOURS.items() if mode in modes],
    ncols=6,
    loc="lower left",
    bbox_to_anchor=(0, 1),
    frameon=False,
    fontsize=8,
)
for axis, name, label in (
    (drag, "Cd", "wall $C_d$"),
    (lift, "Cl", "$C_l$"),
    (action, "action", r"action / $U_\infty W$"),
):
    axis.plot(seconds, healthy.series[name], color="0.6", label="healthy")
    axis.plot(seconds, faulty.series[name], color="tab:red", linewidth=1.1, label="with faults")
    axis.set_ylabel(label)
    axis.grid(alpha=0.3)
    for moment in (2.5, 3.8):
        axis.axvline(moment, color="0.3", linestyle=":", linewidth=1.0)
drag.legend(loc="lower left", fontsize=8)
action.set(xlim=(seconds[0], seconds[-1]), xlabel="time / s   (dotted: the sensor dies, frames begin to be lost)")
plt.show()

# %%
# Line by line: each change of the ECU's state, and the reason that it gives on the bus.

changes = np.flatnonzero(np.diff(faulty.series["mode"], prepend=-1))
for k in changes[:12]:
    print(f"{seconds[k]:5.2f} s  {modes[k].name:8s} {Reason(int(faulty.series['reason'][k])).name}")
print(f"... {len(changes)} changes in all, the last at {seconds[changes[-1]]:.2f} s to {modes[changes[-1]].name}")
noticed = next((time_s for time_s, bits in statuses if bits), None)
print(f"sensor set aside: {'never' if noticed is None else f'at {noticed:.2f} s, {noticed - 2.5:.2f} s after it died'}")

# %%
# What the ECU did
# ----------------
# - **The dead sensor.** Each pressure is estimated from the others, and the one that contradicts them is set aside: the
#   controller gets the estimate in its place, and goes on. ``EcuStatus`` names it. The state stays CONTROL.
# - **The lost frames.** One missing pressure: the last command is held (HOLD). Two or three in a row: it is halved each
#   period (DECAY). Four in a row, or too many in a second: the jets are shut, and the state is FAULT.
# - **It stays shut.** FAULT is latched. Good frames alone do not end it: the vehicle must take its request back and
#   raise it again. The wake goes back to its own drag, which takes longer than is shown.
#
# What this page is not
# ---------------------
# The runs are of 4.8 s, from one start, on a mesh that is coarser than the default. The side force takes about 4 s to
# calm down, so the drag here is not the release's figure: ``stillwake run runs/demo`` has that. For one fault on the
# default mesh, with a report: ``stillwake run runs/dead --disturb dead:sensor=base_9@10..``. For every fault, from
# several starts, judged by limits that you set: ``stillwake campaign``. The page :doc:`Disturbances of a run
# </reference/disturbances>` lists all kinds, and :doc:`States of the ECU </reference/states>` has the table that the
# ECU follows.
