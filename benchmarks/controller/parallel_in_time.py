"""Whether a roll-out could be computed as a batch over the horizon, instead of step after step.

    python -m benchmarks parallel-in-time [--model DIR] [--dataset H5] [--json FILE]

An iteration of Adam moves the plan little, so that the latent states of the iterate before nearly solve z_{k+1} =
f(z_k, a_k) for the new plan too. A sweep computes f for all steps at once and solves the recursion with a Jacobian J_k
in the place of f,

    e_{k+1} = J_k e_k + f(z_k, a_k) - z_{k+1},    e_0 = 0,    z <- z + e,

which is Newton's step if J_k = df/dz at (z_k, a_k) (W. L. Miranker and W. Liniger, 1967; parallel in time because only
8x8 products are left in the recursion). Measured are the sweeps that it takes, for the shipped model in recorded
situations under control and with Jacobians that cost more or less; and what ONNX Runtime takes for a sweep, for a
roll-out, and for the Jacobians. An error is the largest of all latent states' of all steps.
"""

import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Annotated, Any, Final

import numpy as np
import onnxruntime
import typer
from rich.table import Table

from benchmarks.common.command_line import MODEL, Dataset, JsonFile, Model, console, save, track
from benchmarks.controller.situations import choose_episode, encode_windows, receding, snapshot_steps
from contract.arrays import Array
from contract.config.loading import load_config
from contract.model import model_folder
from contract.recording import dataset
from contract.results import versions
from contract.runtime.onnx_session import OnnxController
from contract.shipped import RECORDING
from export.gates.parity import control_cases
from export.program.controller_program import ControllerProgram
from export.program.from_training import program_of
from export.program.random_program import random_program
from export.program.weights import Linear
from export.reference.model import step, step_adjoint
from export.reference.mpc import adam, rollout, shift
from export.to_onnx.control_step import build_controller
from export.to_onnx.dynamics import Dynamics
from export.to_onnx.graph_builder import Graph
from export.to_onnx.weights import NormNames, store_for

SWEEPS: Final = 8
TOLERANCE: Final = 1e-5
"""Of latent states: what a graph's actions may differ by from the reference's."""
_RENEWED: Final = "of every sweep"


def main(
    json_file: JsonFile = None,
    model: Model = MODEL,
    data: Dataset = RECORDING,
    snapshots: Annotated[int, typer.Option(min=2, help="Situations over the episode.")] = 200,
    repeats: Annotated[int, typer.Option(min=1, help="Runs of each graph.")] = 500,
) -> None:
    """Count sweeps, time graphs, print both."""
    trained = model_folder.read(model)
    program = program_of(trained, load_config().mpc)
    episode = choose_episode(dataset.read(data))
    z, previous_action = encode_windows(program, episode, snapshot_steps(program, episode, snapshots))
    learning_rates = np.full(snapshots, program.mpc.learning_rate)
    warm = shift(receding(program, z[:-1], previous_action[:-1], learning_rates)[-1])
    every = [program.mpc.learning_rate] * program.mpc.iterations
    plans = [warm, *adam(program, z[-1], warm, previous_action[-1], every)]
    figures: dict[str, Any] = {"convergence": convergence(program, z[-1], plans)}
    figures["times"] = [times(of, repeats) for of in (program, random_program(0))]
    _print(figures)
    facts = {
        "dynamics_width": program.dynamics.hidden.weight.shape[0],
        "horizon": program.mpc.horizon,
        "iterations": program.mpc.iterations,
        "learning_rate": program.mpc.learning_rate,
        "tolerance": TOLERANCE,
        "episode": episode.name,
        "snapshots": snapshots,
        "repeats": repeats,
        "weights_sha256": trained.weights_sha256,
        "versions": versions("numpy", "onnxruntime"),
    }
    save(json_file, figures=figures, facts=facts)


def jacobians(program: ControllerProgram, latents: Array, plan: Array) -> Array:
    """df/dz, (..., H, n_z, n_z), at z_0 .. z_H (..., H+1, n_z) and a plan (..., H)."""
    rows = np.eye(latents.shape[-1])
    before = latents[..., :-1, None, :]
    return step_adjoint(program, before, plan[..., None], np.broadcast_to(rows, (*plan.shape, *rows.shape)))[0]


def sweep(program: ControllerProgram, latents: Array, plan: Array, jacobian: Array) -> Array:
    """Better z_0 .. z_H, (..., H+1, n_z), for a plan (..., H), with Jacobians (..., H, n_z, n_z)."""
    residuals = step(program, latents[..., :-1, :], plan) - latents[..., 1:, :]
    corrections = [np.zeros_like(latents[..., 0, :])]
    for k in range(plan.shape[-1]):
        onwards = np.einsum("...ij,...j->...i", jacobian[..., k, :, :], corrections[-1])
        corrections.append(onwards + residuals[..., k, :])
    return latents + np.stack(corrections, axis=-2)


def convergence(program: ControllerProgram, z: Array, plans: list[Array]) -> list[dict[str, Any]]:
    """Errors of the roll-outs of each iteration's plan after so many sweeps from the exact states of the one before.

    Args:
        z: latent states (n, n_z).
        plans: before the first iteration and after each, (n, H).

    Returns:
        A row for each Jacobian: its `jacobian`, `median` and `largest` errors after 0, 1, .. sweeps, and the `sweeps`
        that all need, None if `SWEEPS` are too few.
    """
    exact = [rollout(program, z, plan) for plan in plans]
    first = jacobians(program, exact[0], plans[0])
    kept = {
        "identity": np.broadcast_to(np.eye(z.shape[-1]), first.shape),
        "constant, the mean": np.broadcast_to(first.mean(axis=(0, 1)), first.shape),
        "of the first iterate": first,
    }
    errors: dict[str, list[list[Array]]] = {}
    for i in track(range(1, len(plans)), "iterations", "iterations"):
        choices = {**kept, "of the iterate before": jacobians(program, exact[i - 1], plans[i - 1]), _RENEWED: None}
        for name, choice in choices.items():
            latents, found = exact[i - 1], []
            for _ in range(SWEEPS + 1):
                found.append(np.abs(latents - exact[i]).max(axis=(-2, -1)))
                jacobian = jacobians(program, latents, plans[i]) if choice is None else choice
                latents = sweep(program, latents, plans[i], jacobian)
            errors.setdefault(name, []).append(found)
    return [_row(name, np.concatenate(found, axis=-1)) for name, found in errors.items()]


def _row(name: str, errors: Array) -> dict[str, Any]:
    """Of errors (SWEEPS + 1, situations)."""
    largest = errors.max(axis=-1)
    enough = np.flatnonzero(largest <= TOLERANCE)
    return {
        "jacobian": name,
        "median": np.median(errors, axis=-1).tolist(),
        "largest": largest.tolist(),
        "sweeps": int(enough[0]) if len(enough) else None,
    }


def times(program: ControllerProgram, repeats: int) -> dict[str, Any]:
    """`microseconds` of a program, and what a step could gain at most."""
    found = microseconds(program, repeats)
    widths = {"dynamics_width": len(program.dynamics.norm_in.weight), "iterations": program.mpc.iterations}
    return {**widths, **found, "most_times_faster": most_times_faster(found, program.mpc.iterations)}


def microseconds(program: ControllerProgram, repeats: int) -> dict[str, float]:
    """Medians of processor time of each graph on one thread, interleaved, less that of an empty one."""
    (case,) = control_cases(program, count=1)
    whole = OnnxController(build_controller(program).SerializeToString(), program.sizes)
    sessions = {name: _session(model) for name, model in graphs(program).items()}
    rng = np.random.default_rng(0)
    feeds = {
        name: {item.name: 0.01 * rng.standard_normal(item.shape).astype(np.float32) for item in session.get_inputs()}
        for name, session in sessions.items()
    }
    steps: dict[str, Callable[[], object]] = {
        name: partial(session.run, None, feeds[name]) for name, session in sessions.items()
    }
    steps["step"] = lambda: whole.control_step(case.window, case.plan, case.free)
    taken: dict[str, list[float]] = {name: [] for name in steps}
    for _ in track(range(repeats), "graphs", "runs"):
        for name, run in steps.items():
            began = time.thread_time()
            run()
            taken[name].append((time.thread_time() - began) * 1e6)
    medians = {name: float(np.median(values)) for name, values in taken.items()}
    empty = medians.pop("empty")
    return {name: median - empty for name, median in medians.items()}


def most_times_faster(of: Mapping[str, float], iterations: int) -> float:
    """A bound for the whole step: if one evaluation of f over the horizon were all that each roll-out takes behind the
    first one, without Jacobians, recursion or check."""
    return of["step"] / (of["step"] - iterations * (of["rollout"] - of["evaluation"]))


def graphs(program: ControllerProgram) -> dict[str, bytes]:
    """Parts of a control step: a roll-out step after step; f at all steps; a whole sweep; Jacobians from the factors
    that the adjoint makes (`export.to_onnx.dynamics`); and nothing."""
    horizon, latent = program.mpc.horizon, program.dynamics.latent
    width = len(program.dynamics.norm_in.weight)
    made = {}

    graph = Graph()
    z, plan = graph.input("z", (1, latent)), graph.input("plan", (1, horizon))
    latents = Dynamics(graph, program, store_for(program)).rollout(graph, z, plan).latents
    made["rollout"] = _model(graph, latents, (horizon, latent))

    graph = Graph()
    before, after, actions = _states(graph, horizon, latent)
    residuals = graph.op("Sub", _all_steps(graph, program, before, actions), after)
    made["evaluation"] = _model(graph, residuals, (horizon, latent))

    graph = Graph()
    before, after, actions = _states(graph, horizon, latent)
    residuals = graph.op("Sub", _all_steps(graph, program, before, actions), after)
    corrections = _recursion(graph, residuals, graph.input("jacobian", (horizon, latent, latent)), latent)
    squeezed = graph.op("Squeeze", corrections, graph.index([1]))
    made["sweep"] = _model(graph, graph.op("Add", after, squeezed), (horizon, latent))

    graph = Graph()
    into, out = graph.input("into", (horizon, latent, width)), graph.input("out", (horizon, width, latent))
    rows = graph.op("Reshape", into, graph.index([horizon * latent, width]))
    through = graph.op("MatMul", rows, graph.constant(program.dynamics.hidden.weight))
    steps = graph.op("Reshape", through, graph.index([horizon, latent, width]))
    made["jacobians"] = _model(graph, graph.op("MatMul", steps, out), (horizon, latent, latent))

    graph = Graph()
    made["empty"] = _model(graph, graph.op("Relu", graph.input("z", (1, latent))), (1, latent))
    return made


def _states(graph: Graph, horizon: int, latent: int) -> tuple[str, str, str]:
    """z_0 .. z_{H-1}, z_1 .. z_H, and the actions as a column."""
    shape = (horizon, latent)
    return graph.input("before", shape), graph.input("after", shape), graph.input("actions", (horizon, 1))


def _all_steps(graph: Graph, program: ControllerProgram, before: str, actions: str) -> str:
    """f at (H, n_z) and (H, 1)."""
    weights = program.dynamics
    per_action = graph.constant(1.0 / program.scaling.action_std)
    x = graph.op("Concat", before, graph.op("Mul", actions, per_action), axis=1)
    for layer, norm in ((weights.input, weights.norm_in), (weights.hidden, weights.norm_hidden)):
        x = graph.op("Elu", NormNames(graph, norm, "norm").apply(graph, _linear(graph, layer, x)))
    return graph.op("Add", before, _linear(graph, weights.output, x))


def _linear(graph: Graph, layer: Linear, x: str) -> str:
    return graph.op("Gemm", x, graph.constant(layer.weight), graph.constant(layer.bias), transB=1)


def _recursion(graph: Graph, residuals: str, jacobian: str, latent: int) -> str:
    """e_1 .. e_H, (H, 1, n_z)."""
    body = graph.body()
    e, r, j = body.input("e", (1, latent)), body.input("r", (latent,)), body.input("j", (latent, latent))
    following = body.op("Gemm", e, j, r, transB=1)
    body.output(following, (1, latent))
    body.output(body.op("Identity", following), (1, latent))
    zero = graph.constant(np.zeros((1, latent)))
    return graph.scan(body, states=[zero], sequences=[residuals, jacobian])[1]


def _model(graph: Graph, output: str, shape: tuple[int, ...]) -> bytes:
    graph.output(output, shape, "result")
    serialised: bytes = graph.model("part", "A part of a control step").SerializeToString()
    return serialised


def _session(model: bytes) -> Any:
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    return onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])


def _print(figures: dict[str, Any]) -> None:
    table = Table("J", *(f"{sweeps}" for sweeps in range(SWEEPS + 1)), f"sweeps to {TOLERANCE:g}")
    for row in figures["convergence"]:
        table.add_row(
            row["jacobian"], *(f"{error:.0e}" for error in row["largest"]), str(row["sweeps"] or f"over {SWEEPS}")
        )
    console.print("Largest error after so many sweeps", table, sep="\n")
    names = tuple(figures["times"][0])
    table = Table(*names, title="Processor time in us")
    for row in figures["times"]:
        table.add_row(*(f"{row[name]:.4g}" for name in names))
    console.print(table)
