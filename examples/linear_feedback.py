"""Fit a linear controller of the wake to the shipped recording, run it in the environment, and print the drag.

    python examples/linear_feedback.py [control steps]

An autoregressive model predicts the pressure differences between mirrored sensors, Cl and the velocity in the far wake
(Ljung, System Identification, section 4.2). In the mirror image of a flow, these quantities and the action have the
opposite sign, so the model has no constant term. The model's state is the measured history of differences and actions,
so the linear-quadratic regulator (Anderson and Moore, Optimal Control, section 3.4) needs no observer.
"""

import sys

import gymnasium
import numpy as np
import scipy.linalg
from rich import print

import wake.env  # noqa: F401  (registers the environment)
from contract.arrays import Array
from contract.recording import dataset
from contract.shipped import recording

SENSORS = ("upper_39", "lower_39", "base_0", "base_9")
"""Names of the sensors in pairs: each sensor is followed by its mirror image."""
MEMORY, TRANSIENT = 64, 500
"""Number of control steps that the model reads; number of steps at each episode's start that the fit leaves out."""
RIDGE = 1e-3
"""Weight of the ridge penalty of the regression, for regressors that are scaled to a mean square of 1."""
WEIGHTS, ACTION_WEIGHT = (10.0, 10.0, 1.0, 1.0), 100.0
"""Weights of the squared predicted quantities, and weight of the squared action, in the regulator's cost."""


def identified() -> Array:
    """Fit the model to the recording; return its coefficients, (4, 3 MEMORY). The coefficients multiply the last MEMORY
    rows (y_k, a_k), oldest first, and give the two pressure differences y, Cl and the velocity one step ahead."""
    histories, following = [], []
    recorded = dataset.read(recording())
    for episode in recorded.episodes:
        if episode.name.startswith("controlled"):
            Cp, action, *responses = (episode.series[name][TRANSIENT:] for name in ("Cp", "action", "Cl", "Uy_probe"))
            Cp = Cp[:, recorded.layout.indices(SENSORS)]
            rows = np.column_stack([Cp[:, ::2] - Cp[:, 1::2], action])
            windows = np.lib.stride_tricks.sliding_window_view(rows, MEMORY, axis=0)[:-1]
            histories.append(windows.transpose(0, 2, 1).reshape(len(windows), -1))
            following.append(np.column_stack([rows[:, :-1], *responses])[MEMORY:])
    X, Y = np.concatenate(histories), np.concatenate(following)
    scale = np.sqrt((X**2).mean(axis=0))
    X /= scale
    solved = scipy.linalg.solve(X.T @ X / len(X) + RIDGE * np.eye(len(scale)), X.T @ Y / len(X), assume_a="pos")
    return np.asarray((solved / scale[:, None]).T)


def regulator(model: Array) -> Array:
    """Return the gains from the history to a_k. The discrete Riccati equation yields gains that stabilise the model."""
    size = model.shape[1]
    # The next history, without the action, consists of the present history's newer rows and the predicted differences.
    moved = np.vstack([np.eye(size - 3, size, 3), model[:2]])
    A, B, outputs, by_action = moved[:, :-1], moved[:, -1:], model[:, :-1], model[:, -1:]
    Q = np.diag(WEIGHTS)
    state = outputs.T @ Q @ outputs + 1e-9 * np.eye(len(A))
    cross, control = outputs.T @ Q @ by_action, by_action.T @ Q @ by_action + ACTION_WEIGHT
    P = scipy.linalg.solve_discrete_are(A, B, state, control, s=cross)
    return np.asarray(-np.linalg.solve(control + B.T @ P @ B, B.T @ P @ A + cross.T)[0])


if __name__ == "__main__":
    steps = int(sys.argv[1]) if len(sys.argv) > 1 else 500
    env = gymnasium.make("stillwake/TruckWake-v0", sensor_names=SENSORS, episode_steps=steps)
    gain = regulator(model := identified())
    Cp, info = env.reset(seed=0, options={"phase_steps": 0})
    history, action, found, truncated = np.zeros(len(gain)), 0.0, [], False
    while not truncated:
        history = np.concatenate([history[3:], [action], Cp[::2] - Cp[1::2]])
        action = float(np.clip(gain @ history, -0.075, 0.075))
        Cp, _, _, truncated, info = env.step([action])
        found.append([info[name] for name in ("Cd", "Cd_net", "Cl", "jet_power")])
    settled = np.array(found[2 * len(found) // 5 :])
    Cd, net, _, power = settled.mean(axis=0)
    swing = np.abs(settled[:, 2]).mean()
    print(f"Cd {Cd:.3f} (1.026 without control), net {net:.3f}, |Cl| {swing:.3f}, jet power {power:.3f}")
