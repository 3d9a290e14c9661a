r"""
What a fault does to the loop
=============================

For validation engineers who want to see how the ECU reacts to a dead sensor and to lost frames, before they read the
table of its states. At the end you have run the closed loop without and with faults, and can replace these faults by
other faults.

The flow is computed while this page is built, on a mesh coarser than the default mesh, and for a short time. The last
section states the consequences.
"""

# %%
# The release, the vehicle and the wake
# -------------------------------------
# The simulated ECU runs the shipped release. The mesh has the refinement 0.75. It is coarser than the default mesh, but
# the controller has the same benefit. The shipped wake is interpolated to this mesh, and runs without control
# until the effects of the interpolation have decayed.

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
# A run is in virtual time, and depends only on release, settings, start and disturbances. All machines give equal runs.
# Every 20 ms the vehicle sends the pressures over a simulated CAN FD bus, the ECU answers with a command and its
# status, and the jets follow. Control is requested from 1.3 s on. Each disturbance is a line of text with times in s:
#
# - one sensor on the base reads Cp 0 from 2.5 s on,
# - from 3.8 s on half of the vehicle's frames, chosen at random from a seed, are lost.

from can_bridge.wire import codec
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import ECU_STATUS
from firmware_sim.bench.disturbances import Disturbances
from firmware_sim.bench.simulation import Simulation, Spans
from firmware_sim.runs.run_log import RunLog

FAULTS = ("dead:sensor=base_9@2.5..", "vehicle:drop:probability=0.5@3.8..")
spans = Spans(lead_in=13.0, controlled=35.0, settle=0.0, averages=False)


def run(disturbances: tuple[str, ...]) -> tuple[RunLog, list[tuple[float, int]]]:
    """Return the log of a run, and from each status frame of the ECU: (time in s, excluded sensors as bits)."""
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
# The strip at the top shows the ECU's state in the run with faults. Until the first fault both runs are equal.

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
# Each line is a change of the ECU's state, with the reason that the ECU sends on the bus.

changes = np.flatnonzero(np.diff(faulty.series["mode"], prepend=-1))
for k in changes[:12]:
    print(f"{seconds[k]:5.2f} s  {modes[k].name:8s} {Reason(int(faulty.series['reason'][k])).name}")
print(f"... {len(changes)} changes in all, the last at {seconds[changes[-1]]:.2f} s to {modes[changes[-1]].name}")
noticed = next((time_s for time_s, bits in statuses if bits), None)
print(f"sensor set aside: {'never' if noticed is None else f'at {noticed:.2f} s, {noticed - 2.5:.2f} s after it died'}")

# %%
# What the ECU did
# ----------------
# - **The dead sensor.** The ECU estimates each pressure from the others, and excludes a sensor that contradicts them:
#   the controller gets the estimate instead, and continues. ``EcuStatus`` names this sensor. The state stays CONTROL.
# - **The lost frames.** The ECU holds the last command after one missing frame (HOLD), and halves the command in each
#   period after two or three (DECAY). After four in a row, or too many in a second, it shuts the jets (FAULT).
# - **The latched fault.** Good frames alone do not end FAULT: the vehicle must withdraw its request and then request
#   control again. The drag returns to its value without control, but this takes longer than the plots show.
#
# What this page does not show
# ----------------------------
# The runs last 4.8 s, from one start, on a mesh coarser than the default mesh. The side force needs about 4 s to
# decrease, so this drag is not the release's figure; ``stillwake run runs/demo`` gives that figure.
# ``stillwake run runs/dead --disturb dead:sensor=base_9@10..`` runs one fault on the default mesh and writes a report.
# ``stillwake campaign`` runs all faults from several starts, and judges them by limits that you set. The page
# :doc:`Disturbances of a run </reference/disturbances>` lists all disturbances, and :doc:`States of the ECU
# </reference/states>` has the table that the ECU follows.
