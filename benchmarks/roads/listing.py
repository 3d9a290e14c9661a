"""Every road by its name on the command line, and the module in this folder whose `measure` makes its row."""

from typing import Final

ROADS: Final = {
    "no-control": "without",
    "steady": "without",
    "constant": "baselines",
    "sine": "baselines",
    "proportional": "baselines",
    "opposition": "baselines",
    "phase-control": "baselines",
    "bang-bang": "baselines",
    "ppo": "rl",
    "sac": "rl",
    "through-flow": "through_flow",
    "release": "release",
    "calm-tuned": "calm_tuned",
    "mpc-90": "mpc_90",
    "linear": "linear",
    "linear-under-release": "linear",
}
